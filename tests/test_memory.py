"""Freed memory goes back to the system."""

import platform
import subprocess
import sys

import pytest

FREEING = """
import numpy as np
from pavetwin.memory import give_back

def resident_mib():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmRSS")).split()[1]) / 1024

# Small enough to come from the heap, and one last of them stays, so that the heap's end can not just be cut off.
held = [np.ones(12_000) for _ in range(2000)]
last = np.ones(12_000)
full = resident_mib()
held.clear()
freed = resident_mib()
give_back()
print(full - freed, full - resident_mib())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries give memory back by themselves")
def test_what_was_freed_is_given_back() -> None:
    """Arrays of 180 MiB in all."""
    told = subprocess.run([sys.executable, "-c", FREEING], capture_output=True, text=True, check=True).stdout.split()
    before, after = map(float, told)
    assert after > 150
    assert before < after

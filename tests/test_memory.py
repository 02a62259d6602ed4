"""Freed memory goes back to the system, or is kept for the next request."""

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
    reported = subprocess.run(
        [sys.executable, "-c", FREEING], capture_output=True, text=True, check=True
    ).stdout.split()
    before, after = map(float, reported)
    assert after > 150
    assert before < after


KEEPING = """
import resource
import sys
import numpy as np
from pavetwin.memory import keep_freed

def faults_of_arrays():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        held = [np.ones(2**19) for _ in range(6)]
        del held
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

without = faults_of_arrays()
keep_freed()
faults_of_arrays()
print(without, faults_of_arrays())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries keep memory by rules of their own")
def test_what_was_freed_is_kept_for_the_next_arrays() -> None:
    """Pages that the system has to clear for arrays of 4 MiB that come and go."""
    reported = subprocess.run(
        [sys.executable, "-c", KEEPING], capture_output=True, text=True, check=True
    ).stdout.split()
    before, after = map(int, reported)
    assert before > 1000
    assert after < before / 10

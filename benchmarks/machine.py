"""The machine of the measurements, and whether it was busy."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pavetwin.training.evaluation.comparison import processor

BUSY_SHARE = 0.5
"""Above this load for each core, measured before the benchmarks begin, other programs take part in the result."""

PACKAGES = ("pavetwin", "numpy", "shapely", "eclipse-sumo")


def describe() -> dict[str, str]:
    """The machine and the versions that matter, in words."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {
        "CPU": f"{processor()}, {cores} {'core' if cores == 1 else 'cores'}",
        "memory": _memory(),
        "system": f"{_distribution()}, {platform.system()} {platform.release()}",
        "versions": ", ".join([f"Python {platform.python_version()}", *(f"{n} {_version(n)}" for n in PACKAGES)]),
    }


def load() -> tuple[str, bool]:
    """The load average in words, and whether the machine is busy with something else."""
    if not hasattr(os, "getloadavg"):
        return "load unknown", False
    one, five, _ = os.getloadavg()
    return f"load average {one:.2f} (1 min), {five:.2f} (5 min)", one > BUSY_SHARE * (os.cpu_count() or 1)


def _memory() -> str:
    for line in _lines("/proc/meminfo"):
        if line.startswith("MemTotal"):
            return f"{int(line.split()[1]) / 2**20:.1f} GiB"
    return "unknown"


def _distribution() -> str:
    for line in _lines("/etc/os-release"):
        if line.startswith("PRETTY_NAME"):
            return line.partition("=")[2].strip('"')
    return platform.platform()


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"

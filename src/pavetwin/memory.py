"""Memory that was freed: given back to the system, or kept for the next request."""

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Final

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt` (its `malloc.h`)."""

KEPT_BYTES: Final = 128 * 2**20
"""Free memory at a heap's end that is kept: what the temporary arrays of a tile take. Each thread may have a heap."""

ON_HEAP_BYTES: Final = 32 * 2**20
"""Larger arrays are mapped and unmapped each; glibc allows no more."""


@cache
def _trim() -> Callable[[int], int] | None:
    """glibc's `malloc_trim`; None where the C library is another one, which gives memory back by itself."""
    try:
        found = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    found.argtypes, found.restype = [ctypes.c_size_t], ctypes.c_int
    return found


def give_back() -> None:
    """Return freed memory to the system, after work with large arrays.

    glibc keeps memory freed by threads for their next request, however large: half a gigabyte after building the
    ground's textures.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def keep_freed() -> None:
    """Keep what a thread has freed, up to `KEPT_BYTES`, for its next request, from now on: before work that makes and
    drops arrays of some MB each again and again. `give_back` gives it back.

    glibc gives such memory back at once, and the system clears each page of it again: a quarter of the time of a tile's
    maps.
    """
    try:
        option = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    option.argtypes, option.restype = [ctypes.c_int, ctypes.c_int], ctypes.c_int
    option(_MMAP_THRESHOLD, ON_HEAP_BYTES)
    option(_TRIM_THRESHOLD, KEPT_BYTES)

"""Memory that was freed, given back to the system."""

import ctypes
from collections.abc import Callable
from functools import cache


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
    """Give freed memory back: after work whose arrays are large and gone.

    glibc keeps what threads have freed for their next request, however large it was: half a gigabyte after the ground's
    textures are made.
    """
    trim = _trim()
    if trim is not None:
        trim(0)

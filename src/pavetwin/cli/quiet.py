"""Keeps what libraries print off the terminal: it shows the program's own lines only."""

import logging
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import UnsupportedOperation
from typing import TextIO

from pavetwin.errors import CacheWarning

STDERR = 2


@contextmanager
def quiet() -> Iterator[None]:
    """Drop Python's warnings, logs without a handler, and all that native libraries and child processes print on the
    error stream. The program's own errors, progress and warnings still reach it, as `sys.stderr`; each warning once."""
    root, handler, own = logging.getLogger(), logging.NullHandler(), sys.stderr
    sys.stderr.flush()
    terminal = os.dup(STDERR)
    if _is_native(own):
        sys.stderr = os.fdopen(os.dup(STDERR), "w", 1, encoding=own.encoding, errors=own.errors)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    root.addHandler(handler)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    try:
        with warnings.catch_warnings():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
                warnings.simplefilter("once", CacheWarning)
                warnings.showwarning = _tell
            yield
    finally:
        os.dup2(terminal, STDERR)
        os.close(terminal)
        root.removeHandler(handler)
        if sys.stderr is not own and _is_native(own):
            sys.stderr.close()
            sys.stderr = own


def _tell(
    message: Warning | str,
    category: type[Warning],  # noqa: ARG001 - the signature of `warnings.showwarning`
    filename: str,  # noqa: ARG001
    lineno: int,  # noqa: ARG001
    file: TextIO | None = None,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> None:
    print(message, file=sys.stderr)


def _is_native(stream: object) -> bool:
    """Whether a stream is the process's error stream, and not one that a caller put in its place."""
    try:
        return stream.fileno() == STDERR  # type: ignore[attr-defined, no-any-return]
    except (AttributeError, UnsupportedOperation, ValueError):
        return False

"""Loads wgpu without parsing its header: cffi's tables of it are kept in the cache.

wgpu hands its header to cffi as text, 108 kB. cffi parses it at every start, and all its types again before each that
is used, by a parser in Python: 1.5 s. The tables that cffi would write for an "out-of-line" module need 10 ms.
"""

import ast
import hashlib
import threading
from io import StringIO
from typing import Any, Final

import _cffi_backend
import cffi
import numpy as np
from cffi import FFI

from pavetwin.scene.texture_cache import kept

_PATCHING: Final = threading.Lock()


class ParsedFFI:
    """As `cffi.FFI`, for one header and a library that is opened by its path."""

    def __init__(self) -> None:
        self._parsed: Any = None

    def cdef(self, header: str) -> None:
        """Take the declarations of a header."""
        variant = hashlib.sha256(f"{cffi.__version__} {header}".encode()).hexdigest()[:16]
        source = kept("header", lambda: {"source": np.frombuffer(_tables(header), np.uint8)}, variant)["source"]
        call = ast.parse(source.tobytes()).body[-1]
        assert isinstance(call, ast.Assign)
        assert isinstance(call.value, ast.Call)
        tables = {str(each.arg): ast.literal_eval(each.value) for each in call.value.keywords}
        self._parsed = _cffi_backend.FFI("wgpu", **tables)

    def set_source(self, *_: object) -> None:
        """Nothing is compiled."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._parsed, name)


def load_wgpu() -> None:
    """Import wgpu's native backend, with its header from the cache.

    Raises:
        ImportError: it is not installed.
        OSError: its library does not load.
    """
    with _PATCHING:
        cffi.FFI = ParsedFFI
        try:
            import wgpu.backends.wgpu_native  # noqa: F401 - loaded, not used
        finally:
            cffi.FFI = FFI


def _tables(header: str) -> bytes:
    """The Python source of an out-of-line module: one call of `_cffi_backend.FFI`, all its arguments literals."""
    builder, source = FFI(), StringIO()
    builder.cdef(header)
    builder.set_source("wgpu", None, compiler_verbose=False)
    builder.emit_python_code(source)
    return source.getvalue().encode()

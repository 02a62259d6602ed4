"""The graphics adapter: a graphics card, or the CPU through Mesa's lavapipe. Loads wgpu with its header cached."""

import ast
import hashlib
import os
import threading
from dataclasses import dataclass
from functools import cache
from io import StringIO
from typing import Any, Final, Literal

import _cffi_backend
import cffi
import numpy as np
from cffi import FFI

from pavetwin.errors import PaveTwinError
from pavetwin.scene.texture_cache import kept

_PATCHING: Final = threading.Lock()


class ParsedFFI:
    """A `cffi.FFI` for one header and a library that is opened by its path."""

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


NEEDED: Final = (
    "Rendering needs a Vulkan adapter, and none was found; on Debian or Ubuntu without a graphics card: "
    "sudo apt-get install mesa-vulkan-drivers"
)

_BACKENDS: Final = ("Vulkan", "Metal", "DX12")
"""OpenGL is left out: it loads window-system libraries on servers, and misses features that the shaders need."""


@dataclass(frozen=True)
class Adapter:
    """The device that renders frames."""

    name: str
    kind: Literal["cpu", "gpu"]
    driver: str
    """Driver version or description, and the graphics API."""

    def __str__(self) -> str:
        return f"{self.name} ({'processor' if self.kind == 'cpu' else 'graphics card'}; {self.driver})"


def find_adapter() -> Adapter:
    """The adapter that frames are drawn with.

    Raises:
        PaveTwinError: there is none; the message names the package that provides one.
    """
    info = _best().info
    kind: Literal["cpu", "gpu"] = "cpu" if str(info["adapter_type"]).lower() == "cpu" else "gpu"
    driver = ", ".join(part for part in (str(info["description"]), str(info["backend_type"])) if part)
    return Adapter(str(info["device"]), kind, driver)


@cache
def open_device() -> Any:
    """The device (`wgpu.GPUDevice`) of that adapter, one for the whole process.

    Raises:
        PaveTwinError: there is no adapter, or its driver refuses.
    """
    adapter = _best()
    try:
        return adapter.request_device_sync(label="pavetwin")
    except RuntimeError as error:
        raise PaveTwinError(f"{find_adapter()} cannot be used: {' '.join(str(error).split())}") from error


@cache
def _best() -> Any:
    """The adapter (`wgpu.GPUAdapter`): graphics cards before the CPU."""
    # Without a desktop Mesa still looks for a Wayland socket, and reports its absence on stderr.
    os.environ.setdefault("XDG_RUNTIME_DIR", "/tmp")
    try:
        load_wgpu()
        import wgpu

        _choose_backends()
        adapters = wgpu.gpu.enumerate_adapters_sync()
    except (ImportError, OSError) as error:
        raise PaveTwinError(f"frames need the package wgpu, which does not load: {error}") from error
    if not adapters:
        raise PaveTwinError(NEEDED)
    order = {"DiscreteGPU": 0, "IntegratedGPU": 1, "VirtualGPU": 2, "CPU": 4}
    return min(adapters, key=lambda adapter: order.get(str(adapter.info["adapter_type"]), 3))


@cache
def _choose_backends() -> None:
    """Called once per process: wgpu refuses it after adapters were listed, which also happens when none was found."""
    from wgpu.backends.wgpu_native.extras import set_instance_extras

    set_instance_extras(backends=_BACKENDS)

"""The graphics adapter: a graphics card, or the CPU through Mesa's lavapipe."""

import os
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Literal

from pavetwin.errors import PaveTwinError

NEEDED: Final = (
    "Rendering needs a Vulkan adapter, and none was found; on Debian or Ubuntu without a graphics card: "
    "sudo apt-get install mesa-vulkan-drivers"
)

_BACKENDS: Final = ("Vulkan", "Metal", "DX12")
"""OpenGL is left out: it loads window-system libraries on servers, and lacks features that the shaders need."""


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
        from pavetwin.render.header import load_wgpu

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

"""Which graphics adapter draws: a card, or the processor by Mesa's lavapipe."""

import os
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Literal

from pavetwin.errors import PaveTwinError

NEEDED: Final = (
    "Frames need a Vulkan adapter, and there is none here; on Debian or Ubuntu without a graphics card: "
    "sudo apt-get install --yes mesa-vulkan-drivers"
)

_BACKENDS: Final = ("Vulkan", "Metal", "DX12")
"""OpenGL is left out: it opens windows' libraries on servers, and lacks what the shaders need."""


@dataclass(frozen=True)
class Adapter:
    """What draws the frames."""

    name: str
    kind: Literal["cpu", "gpu"]
    driver: str
    """Its version or description, and the interface it is spoken to by."""

    def __str__(self) -> str:
        return f"{self.name} ({'processor' if self.kind == 'cpu' else 'graphics card'}; {self.driver})"


def find_adapter() -> Adapter:
    """The adapter that frames are drawn with.

    Raises:
        PaveTwinError: there is none; names the package that brings one.
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
    """The adapter (`wgpu.GPUAdapter`): cards before the processor."""
    # Without a desktop Mesa looks for a Wayland socket all the same, and complains on stderr.
    os.environ.setdefault("XDG_RUNTIME_DIR", "/tmp")
    try:
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
    """Once a process: wgpu refuses it when adapters were listed before, as they are when none was found."""
    from wgpu.backends.wgpu_native.extras import set_instance_extras

    set_instance_extras(backends=_BACKENDS)

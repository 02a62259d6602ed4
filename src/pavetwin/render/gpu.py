"""Buffers and textures on the device, with a count of the memory in use."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, Final

import cv2
import numpy as np
import wgpu

from pavetwin.arrays import AnyArray, Float32Array, UInt8Array
from pavetwin.scene.ground.materials.sampling import linear_of_srgb, srgb_of_linear

_BUFFER: Final = wgpu.BufferUsage
_TEXTURE: Final = wgpu.TextureUsage

_CHANNELS: Final = {1: "r8unorm", 2: "rg8unorm", 4: "rgba8unorm"}


class Gpu:
    """A device and its memory in use."""

    def __init__(self, device: Any) -> None:
        self.device = device
        self.queue = device.queue
        self.held_bytes = 0
        """Bytes of all buffers and textures made here and not yet freed."""
        self._sizes: dict[int, int] = {}

    def buffer(self, data: AnyArray, usage: int) -> Any:
        """A buffer with these contents."""
        made = self.device.create_buffer_with_data(data=np.ascontiguousarray(data), usage=usage | _BUFFER.COPY_DST)
        return self._hold(made, made.size)

    def empty_buffer(self, size: int, usage: int) -> Any:
        """A buffer of that many bytes."""
        return self._hold(self.device.create_buffer(size=size, usage=usage | _BUFFER.COPY_DST), size)

    def grown(self, buffer: Any, size: int, usage: int) -> Any:
        """A buffer where it holds that many bytes; else a new one of twice as many, and the old one is freed."""
        if buffer is not None and buffer.size >= size:
            return buffer
        if buffer is not None:
            self.free(buffer)
        return self.empty_buffer(2 * size, usage)

    def target(self, size_px: tuple[int, int], format: str, *, usage: int = 0) -> Any:
        """A texture to draw into."""
        made = self.device.create_texture(size=(*size_px, 1), format=format, usage=_TEXTURE.RENDER_ATTACHMENT | usage)
        return self._hold(made, size_px[0] * size_px[1] * (8 if format == "rgba16float" else 4))

    def texture(self, layers: Sequence[UInt8Array], *, srgb: bool = False, rooted: bool = False) -> Any:
        """A texture, or an array of them, to sample, with all halved levels.

        Args:
            layers: each (rows, columns, channels) of 1, 2 or 4 channels; row 0 at v = 0.
            srgb: colours are sRGB-coded (a fourth channel never is).
            rooted: so are they, and the texture is to hold their square roots, which the shader squares: lavapipe takes
                twice as long to sample sRGB.
        """
        if len(layers) == 1:
            pyramids = [halved(layers[0], srgb=srgb, rooted=rooted)]
        else:
            with ThreadPoolExecutor(os.cpu_count()) as pool:  # NumPy leaves the interpreter to others
                pyramids = list(pool.map(partial(halved, srgb=srgb, rooted=rooted), layers))
        return self._sampled(pyramids, _CHANNELS[layers[0].shape[2]] + ("-srgb" if srgb else ""))

    def levelled(self, levels: Sequence[AnyArray]) -> Any:
        """A texture whose levels are made already, each (rows, columns, 4): linear light, or 8-bit numbers."""
        return self._sampled([levels], "rgba16float" if levels[0].dtype == np.float16 else _CHANNELS[4])

    def _sampled(self, pyramids: Sequence[Sequence[AnyArray]], format: str) -> Any:
        """A texture of some layers, each with its levels."""
        rows, columns = pyramids[0][0].shape[:2]
        made = self.device.create_texture(
            size=(columns, rows, len(pyramids)),
            format=format,
            mip_level_count=len(pyramids[0]),
            usage=_TEXTURE.TEXTURE_BINDING | _TEXTURE.COPY_DST,
        )
        for layer, pyramid in enumerate(pyramids):
            for level, texels in enumerate(pyramid):
                rows, columns = texels.shape[:2]
                self.queue.write_texture(
                    {"texture": made, "origin": (0, 0, layer), "mip_level": level},
                    np.ascontiguousarray(texels),
                    {"bytes_per_row": texels.nbytes // rows, "rows_per_image": rows},
                    (columns, rows, 1),
                )
        return self._hold(made, sum(texels.nbytes for pyramid in pyramids for texels in pyramid))

    def free(self, *resources: Any) -> None:
        """Free memory now, without waiting for Python's garbage collector."""
        for resource in resources:
            self.held_bytes -= self._sizes.pop(id(resource))
            resource.destroy()

    def _hold(self, resource: Any, size: int) -> Any:
        self._sizes[id(resource)] = size
        self.held_bytes += size
        return resource


def halved(texels: UInt8Array, *, srgb: bool = False, rooted: bool = False) -> list[UInt8Array]:
    """A texture (rows, columns, channels) and its levels, each half as wide and high, down to one texel."""
    rows, columns = texels.shape[:2]
    if not (srgb or rooted) and rows == columns and rows & (rows - 1) == 0:
        return _quartered(texels)
    colours = min(texels.shape[2], 3) if srgb or rooted else 0
    linear_codes, root_codes = _tables(texels.shape[2], colours)
    levels = [np.asarray(cv2.LUT(texels, root_codes), dtype=np.uint8) if rooted else texels]
    values = np.asarray(cv2.LUT(texels, linear_codes), dtype=np.float32)
    while values.shape[0] > 1 or values.shape[1] > 1:
        if values.shape[0] > 1:
            even = values.shape[0] // 2 * 2
            values = (values[0:even:2] + values[1:even:2]) / np.float32(2)
        if values.shape[1] > 1:
            even = values.shape[1] // 2 * 2
            values = (values[:, 0:even:2] + values[:, 1:even:2]) / np.float32(2)
        coded = values.copy()
        linear = values[..., :colours]
        coded[..., :colours] = 255 * (np.sqrt(linear) if rooted else srgb_of_linear(linear))
        levels.append(np.asarray(coded + 0.5, dtype=np.uint8))
    return levels


@cache
def _tables(channels: int, colours: int) -> tuple[Float32Array, UInt8Array]:
    """By code and channel (1, 256, channels): linear values, and the codes of their roots; of a channel that is no
    colour the code itself."""
    linear = np.repeat(np.arange(256, dtype=np.float32)[:, None], channels, axis=1)
    roots = linear.astype(np.uint8)
    linear[:, :colours], roots[:, :colours] = _LINEAR[:, None], _ROOTS[:, None]
    return linear[None], roots[None]


def _quartered(texels: UInt8Array) -> list[UInt8Array]:
    """The same for a square of 2ⁿ texels, many times as fast: tiles wait for it."""
    levels = [texels]
    while side := len(levels[-1]) // 2:
        fine = levels[-1]
        if texels.shape[2] == 2:  # which OpenCV rounds differently
            wide = fine.astype(np.uint16)
            rows = wide[0::2] + wide[1::2]
            levels.append(((rows[:, 0::2] + rows[:, 1::2] + 2) >> 2).astype(np.uint8))
        else:
            half = cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA)
            levels.append(np.asarray(half, dtype=np.uint8).reshape(side, side, -1))
    return levels


_LINEAR: Final = linear_of_srgb(np.arange(256) / 255)
_ROOTS: Final = np.asarray(255 * np.sqrt(_LINEAR) + 0.5, dtype=np.uint8)
"""Code of the square root of a colour's linear value, indexed by sRGB code."""


def mean_linear(texels: UInt8Array) -> list[float]:
    """The mean linear value of each sRGB-coded colour of a texture (rows, columns, 3 or 4)."""
    counts = [cv2.calcHist([texels], [colour], None, [256], [0, 256])[:, 0].astype(np.int64) for colour in range(3)]
    return [float(count @ _LINEAR.astype(np.float64)) / count.sum() for count in counts]

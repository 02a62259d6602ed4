"""Tiles on the device: uploaded when they are first seen, freed when many others were seen since."""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import wgpu

from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import Crowd, Parts
from pavetwin.render.meshes import GpuMesh, upload_facades, upload_ground, upload_kerbs, upload_patch
from pavetwin.scene.model import Detail, GroundKind, Model, Tile, UInt8

TILES_HELD: Final = 64
"""Tiles on the device, each of some 12 MB."""


class Drawable(Protocol):
    """What a renderer asks of a scene; `scene.Scene` gives it."""

    @property
    def models(self) -> Mapping[str, Model]: ...
    @property
    def details(self) -> Mapping[GroundKind, Detail]: ...
    @property
    def facade_textures(self) -> UInt8: ...
    def tile(self, key: tuple[int, int]) -> Tile: ...
    def keys_near(self, x_m: float, y_m: float, radius_m: float, /) -> tuple[tuple[int, int], ...]: ...


@dataclass(frozen=True)
class GpuPatch:
    """A defect's pavement."""

    label: int
    mesh: GpuMesh
    textures: tuple[Any, Any]
    """Relief and mask."""
    shading: Any
    """Bind group with both."""
    truth: Any
    """Bind group with the mask."""


@dataclass(frozen=True)
class GpuTile:
    """One tile, ready to be drawn."""

    key: tuple[int, int]
    origin: tuple[float, float]
    ground: GpuMesh | None
    kerbs: GpuMesh | None
    facades: GpuMesh | None
    patches: tuple[GpuPatch, ...]
    maps: tuple[Any, Any]
    shading: Any
    """Bind group with the maps."""
    crowd: Crowd


@dataclass(frozen=True)
class Layouts:
    """Bind group layouts that tiles need."""

    maps: Any
    patch: Any
    mask: Any


class TileCache:
    """Tiles by key, the least recently used freed first."""

    def __init__(self, gpu: Gpu, scene: Drawable, parts: Parts, layouts: Layouts, held: int = TILES_HELD) -> None:
        self._gpu, self._scene, self._parts, self._layouts = gpu, scene, parts, layouts
        self._held = held
        self._tiles: OrderedDict[tuple[int, int], GpuTile] = OrderedDict()

    def __len__(self) -> int:
        return len(self._tiles)

    def tile(self, key: tuple[int, int]) -> GpuTile:
        """One tile on the device."""
        if key not in self._tiles:
            self._tiles[key] = self._upload(self._scene.tile(key))
        self._tiles.move_to_end(key)
        return self._tiles[key]

    def trim(self, needed: int) -> None:
        """Free what was not used lately, but not the `needed` last ones. Not while they are drawn."""
        while len(self._tiles) > max(self._held, needed):
            self._free(self._tiles.popitem(last=False)[1])

    def clear(self) -> None:
        for tile in self._tiles.values():
            self._free(tile)
        self._tiles.clear()

    def _upload(self, tile: Tile) -> GpuTile:
        maps = (self._gpu.texture([tile.maps.weathering]), self._gpu.texture([tile.maps.drawn]))
        return GpuTile(
            tile.key,
            tile.origin,
            upload_ground(self._gpu, tile.ground),
            upload_kerbs(self._gpu, tile.ground),
            upload_facades(self._gpu, tile.facades),
            tuple(self._patch(tile, index) for index in range(len(tile.patches))),
            maps,
            group(self._gpu, self._layouts.maps, [each.create_view() for each in maps]),
            Crowd.of(tile.instances, self._parts),
        )

    def _patch(self, tile: Tile, index: int) -> GpuPatch:
        patch = tile.patches[index]
        relief = self._gpu.texture([patch.relief])
        mask = self._gpu.texture([patch.mask[..., None]], levels=False)
        return GpuPatch(
            patch.label,
            upload_patch(self._gpu, patch, tile.origin),
            (relief, mask),
            group(self._gpu, self._layouts.patch, [relief.create_view()]),
            group(self._gpu, self._layouts.mask, [mask.create_view()]),
        )

    def _free(self, tile: GpuTile) -> None:
        meshes = [tile.ground, tile.kerbs, tile.facades, *(patch.mesh for patch in tile.patches)]
        for mesh in meshes:
            if mesh is not None:
                self._gpu.free(*mesh.buffers)
        self._gpu.free(*tile.maps, *(texture for patch in tile.patches for texture in patch.textures))


def group(gpu: Gpu, layout: Any, resources: list[Any]) -> Any:
    """A bind group of resources in the order of their bindings."""
    entries = [{"binding": index, "resource": resource} for index, resource in enumerate(resources)]
    return gpu.device.create_bind_group(layout=layout, entries=entries)


def texture_layout(gpu: Gpu, *dimensions: str, samplers: int = 0, filtered: bool = True) -> Any:
    """Textures that fragments read, in this order, then samplers."""
    sample = "float" if filtered else "unfilterable-float"
    entries: list[dict[str, Any]] = [
        {"texture": {"sample_type": sample, "view_dimension": dimension}} for dimension in dimensions
    ]
    entries += [{"sampler": {"type": "filtering"}}] * samplers
    return gpu.device.create_bind_group_layout(
        entries=[
            {"binding": index, "visibility": wgpu.ShaderStage.FRAGMENT, **entry} for index, entry in enumerate(entries)
        ]
    )

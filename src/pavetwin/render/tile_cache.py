"""Cache of tiles on the device: uploaded when first needed, the least recently used freed first.

Objects on a tile may cast shadows into the image from outside it. The maps and defects of its ground, which cost most,
are made only when they are in view.
"""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

import numpy as np
import wgpu

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import InstanceBatch, PartTable
from pavetwin.render.meshes import GpuMesh, upload_facades, upload_ground, upload_kerbs, upload_patch
from pavetwin.scene.values import DefectPatch, Detail, GroundKind, GroundMaps, Model, Tile, TileKey

TILES_HELD: Final = 192  # Tiles on the device, each of 1 MB at most
PAVEMENTS_HELD: Final = 64  # Their maps and defects, each of some 12 MB
Held = TypeVar("Held")


class Drawable(Protocol):
    """Interface of a scene for renderers; `scene.Scene` implements it."""

    @property
    def models(self) -> Mapping[str, Model]: ...
    @property
    def details(self) -> Mapping[GroundKind, Detail]: ...
    @property
    def facade_textures(self) -> UInt8Array: ...
    def tile(self, key: TileKey) -> Tile: ...
    def maps(self, key: TileKey) -> GroundMaps: ...
    def holes_on(self, key: TileKey) -> Mapping[int, tuple[float, float, float, float]]: ...
    def patch_on(self, key: TileKey, number: int) -> DefectPatch | None: ...
    def strips_on(self, key: TileKey, to_sun: Float64Array) -> Float64Array: ...
    def keys_near(self, x_m: float, y_m: float, radius_m: float, /) -> tuple[TileKey, ...]: ...


@dataclass(frozen=True)
class GpuPatch:
    """A defect's pavement patch."""

    label: int
    mesh: GpuMesh
    coarse: GpuMesh
    textures: tuple[Any, Any]
    """Relief; mask and lost share."""
    shading: Any
    """Bind group with both."""
    masked: Any
    """Bind group with the mask."""


@dataclass(frozen=True)
class GpuTile:
    """The objects on one tile and the shape of its ground, ready to be drawn."""

    key: TileKey
    origin: tuple[float, float]
    ground: GpuMesh | None
    kerbs: GpuMesh | None
    facades: GpuMesh | None
    batch: InstanceBatch


@dataclass(frozen=True)
class GpuPavement:
    """The appearance of a tile's ground: its maps and defects."""

    maps: tuple[Any, Any]
    shading: Any
    """Bind group with the maps."""
    patches: dict[int, GpuPatch | None]
    """Meshes of the defects that were in view; None for one that does not reach the tile."""


@dataclass(frozen=True)
class TileLayouts:
    """Bind group layouts of tiles."""

    maps: Any
    patch: Any
    mask: Any


class TileCache:
    """Least-recently-used cache of tiles and their pavements, by key."""

    def __init__(self, gpu: Gpu, scene: Drawable, parts: PartTable, layouts: TileLayouts) -> None:
        self._gpu, self._scene, self._parts, self._layouts = gpu, scene, parts, layouts
        self._tiles: OrderedDict[TileKey, GpuTile] = OrderedDict()
        self._pavements: OrderedDict[TileKey, GpuPavement] = OrderedDict()

    def __len__(self) -> int:
        """Number of pavements on the device."""
        return len(self._pavements)

    def tile(self, key: TileKey) -> GpuTile:
        """The objects and ground shape of a tile."""
        return _latest(self._tiles, key, lambda: self._upload(self._scene.tile(key)))

    def pavement(self, key: TileKey) -> GpuPavement:
        """The appearance of a tile's ground: its maps and defects."""
        return _latest(self._pavements, key, lambda: self._pave(self._scene.maps(key)))

    def patch(self, tile: GpuTile, number: int) -> GpuPatch | None:
        """The part of a defect's pavement that lies on a tile."""
        patches = self.pavement(tile.key).patches
        if number not in patches:
            made = self._scene.patch_on(tile.key, number)
            patches[number] = None if made is None else self._fill(made, tile.origin)
        return patches[number]

    def trim(self, tiles: int, pavements: int) -> None:
        """Free the least recently used, but keep at least that many of the latest. Not to be called while they are
        drawn."""
        while len(self._tiles) > max(TILES_HELD, tiles):
            self._free_tile(self._tiles.popitem(last=False)[1])
        while len(self._pavements) > max(PAVEMENTS_HELD, pavements):
            self._free_pavement(self._pavements.popitem(last=False)[1])

    def _upload(self, tile: Tile) -> GpuTile:
        return GpuTile(
            tile.key,
            tile.origin,
            upload_ground(self._gpu, tile.ground),
            upload_kerbs(self._gpu, tile.ground),
            upload_facades(self._gpu, tile.facades),
            InstanceBatch.of(tile.instances, self._parts),
        )

    def _pave(self, made: GroundMaps) -> GpuPavement:
        maps = (self._gpu.texture([made.weathering]), self._gpu.texture([made.drawn]))
        return GpuPavement(maps, group(self._gpu, self._layouts.maps, [each.create_view() for each in maps]), {})

    def _fill(self, patch: DefectPatch, origin: tuple[float, float]) -> GpuPatch:
        relief = self._gpu.texture([patch.relief])
        mask = self._gpu.texture([np.stack([patch.mask, patch.lost], axis=-1)])
        mesh = upload_patch(self._gpu, patch, patch.mesh, origin)
        return GpuPatch(
            patch.label,
            mesh,
            mesh if patch.coarse is patch.mesh else upload_patch(self._gpu, patch, patch.coarse, origin),
            (relief, mask),
            group(self._gpu, self._layouts.patch, [relief.create_view(), mask.create_view()]),
            group(self._gpu, self._layouts.mask, [mask.create_view()]),
        )

    def _free_tile(self, tile: GpuTile) -> None:
        for mesh in (tile.ground, tile.kerbs, tile.facades):
            if mesh is not None:
                self._gpu.free(*mesh.buffers)

    def _free_pavement(self, pavement: GpuPavement) -> None:
        self._gpu.free(*pavement.maps)
        for patch in pavement.patches.values():
            if patch is not None:
                self._gpu.free(*patch.mesh.buffers, *patch.textures)
                if patch.coarse is not patch.mesh:
                    self._gpu.free(*patch.coarse.buffers)


def _latest(held: OrderedDict[TileKey, Held], key: TileKey, make: Callable[[], Held]) -> Held:
    """The cached value of a key, made if missing; marks it as the latest used."""
    if key not in held:
        held[key] = make()
    held.move_to_end(key)
    return held[key]


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

"""Pavement patches: for each defect a hole in the ground, filled by the mesh and maps of its heightfield.

A hole is the defect's outline buffered by `BESIDE_M`, its narrow bays closed, as triangles along a ragged ring are
expensive. Outlines lie at least 10 cm from each other and 5 cm from the carriageway's edge, so holes never
meet and never leave the road, whatever the rectangles of their heightfields do.
Beyond its outline a heightfield is level and only dusty or stained; both fade out within the strip, so that the patch
meets the road with the road's own height, slope and reflectance.
"""

from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin._core import relief_mesh
from pavetwin.arrays import Float32Array, Float64Array, UInt8Array
from pavetwin.defects import Heightfield, albedo_factor, heightfield_of, lost_surface, normal_map, occlusion_map
from pavetwin.defects.maps import distances_px
from pavetwin.defects.registry import failures_named
from pavetwin.scene.agents import upright
from pavetwin.scene.light import LUMINANCE
from pavetwin.scene.meshes import upward_normals
from pavetwin.scene.values import PLAIN_FINISH, TILE_M, DefectPatch, Finish, GroundKind, Mesh, defect_label
from pavetwin.world.model import Defect

BESIDE_M: Final = 0.04
"""Distance of a hole's ring from its defect's outline; less than half the least distance between two defects."""

SMOOTHED_M: Final = 0.004  # The outline is simplified within this
RING_M: Final = 0.006
"""And the hole's ring within this: together with `BESIDE_M` half the least distance between two defects."""

BAY_M: Final = 0.05
"""Radius of a disc: where none reaches from outside is hole. One around a point of another defect reaches all of that
one's hole without touching this one."""

TOLERANCE_M: Final = 0.005  # Tolerance of the mesh; finer relief is in the normal map
MOST_VERTICES: Final = 1_500

COARSE_M: Final = 0.012
"""The same of the coarse mesh, whose triangles cover more of the image than what the device shades for each."""

COARSE_VERTICES: Final = 300

COARSE_PIXEL_M: Final = 0.008
"""Pixels of this side on the ground and larger show no difference: 35° off the vertical 12 mm of height lie 8 mm
aside."""

MOST_TEXELS: Final = 1_500_000  # Larger maps are averaged down by whole factors: 6 × 4 m at 4 mm


def holes_of(defects: tuple[Defect, ...]) -> list[Polygon]:
    """The parts of the carriageway that the patches of defects replace, world frame."""
    outlines = np.array([defect.polygon for defect in defects], dtype=object)
    coarse = shapely.simplify(outlines, SMOOTHED_M)
    closed = shapely.buffer(shapely.buffer(coarse, BESIDE_M + BAY_M, quad_segs=4), -BAY_M, quad_segs=4)
    widened = shapely.simplify(closed, RING_M)
    # Where a bay just closes, a speck of no area may be left next to the hole.
    return [Polygon(max(shapely.get_parts(shape), key=shapely.area).exterior) for shape in widened]


def patch_of(
    defect: Defect,
    kind: GroundKind = GroundKind.ASPHALT,
    finish: Finish = PLAIN_FINISH,
    hole: Polygon | None = None,
) -> DefectPatch:
    """The patch of a defect in a pavement of a kind and finish.

    Args:
        hole: that it fills, as `holes_of` makes it, where that is known.

    Raises:
        PaveTwinError: its class is not registered.
        ValueError: its outline crosses itself.
    """
    with failures_named(defect.kind):
        filled = holes_of((defect,))[0] if hole is None else hole
        return replace(_patch(defect, heightfield_of(defect), filled), kind=kind, finish=finish)


def _patch(defect: Defect, field: Heightfield, hole: Polygon) -> DefectPatch:
    transform = upright(defect.centre.x, defect.centre.y, defect.yaw_rad)
    ring = np.asarray(hole.exterior.coords)[:-1] - transform[:2, 3]
    if not shapely.LinearRing(ring).is_ccw:
        ring = ring[::-1]
    ring = np.ascontiguousarray(ring @ transform[:2, :2])
    relief, mask, lost = _maps(field)
    return DefectPatch(
        label=defect_label(defect.id),
        mesh=_mesh(defect, field, ring, TOLERANCE_M, MOST_VERTICES),
        coarse=_mesh(defect, field, ring, COARSE_M, COARSE_VERTICES),
        transform=transform,
        relief=relief,
        mask=mask,
        lost=lost,
    )


def part_on(patch: DefectPatch, key: tuple[int, int]) -> DefectPatch | None:
    """The triangles of a patch whose centres lie on a tile, with the maps of the whole; None if there are none.

    Triangles are not cut: those at the border reach over it by less than the tiles' maps do. Coarse ones would reach
    further, so that such patches have none.
    """
    mesh = patch.mesh
    middles = mesh.positions[mesh.indices].mean(axis=1)[:, :2] @ patch.transform[:2, :2].T + patch.transform[:2, 3]
    mine = (np.floor(middles / TILE_M) == key).all(axis=1)
    if mine.all():
        return patch
    if not mine.any():
        return None
    used, indices = np.unique(mesh.indices[mine], return_inverse=True)
    uv = None if mesh.uv is None else mesh.uv[used]
    triangles = indices.reshape(-1, 3).astype(np.uint32)
    part = Mesh(mesh.positions[used], mesh.normals[used], triangles, uv=uv)
    return replace(patch, mesh=part, coarse=part)


def _mesh(defect: Defect, field: Heightfield, ring: Float64Array, tolerance_m: float, most_vertices: int) -> Mesh:
    made = relief_mesh(field.lattice, field.height_m, ring, tolerance_m, most_vertices)
    if made is None:
        raise ValueError(f"the outline of defect {defect.id} crosses itself")
    positions, indices, _ = made
    upright = upward_normals(len(positions))  # the map holds the whole slope
    return Mesh(positions, upright, indices, uv=field.uv(positions[:, :2].astype(np.float64)))


def _maps(field: Heightfield) -> tuple[UInt8Array, UInt8Array, UInt8Array]:
    """(rows, cols, 4) normal x and y, reflectance, openness; (rows, cols) the label's mask; and the lost share."""
    share = _inward(field)
    factor = 1 + (albedo_factor(field) @ LUMINANCE.astype(np.float32) - 1) * share
    normal = normal_map(field)[..., :2].astype(np.float32) - 127.5
    bent = 128 + normal * share[..., None] * (127 / 127.5)
    openness = 255 + (occlusion_map(field).astype(np.float32) - 255) * share
    channels = (128 * factor, openness, 255 * field.mask.astype(np.float32), 255 * lost_surface(field))
    step = max(1, int(np.ceil(np.sqrt(field.mask.size / MOST_TEXELS))))
    means = averaged(np.concatenate([bent, np.stack(channels, axis=-1)], axis=-1), step)
    coarse = np.clip(np.round(means), 0, 255).astype(np.uint8)
    return coarse[..., :4], (255 * (means[..., 4] >= 127.5)).astype(np.uint8), coarse[..., 5]


def _inward(field: Heightfield) -> Float32Array:
    """(rows, cols): 1 on the outline and inside, falling to 0 before the hole's ring."""
    away = distances_px(~field.mask) * field.cell_m
    ramp = np.clip(1 - away / (BESIDE_M - SMOOTHED_M - RING_M), 0, 1)
    return np.asarray(ramp * ramp * (3 - 2 * ramp), dtype=np.float32)


def averaged(values: Float32Array, step: int) -> Float32Array:
    """Means over step × step cells; the last row and column are repeated to fill them."""
    if step == 1:
        return values
    rows, cols = -values.shape[0] % step, -values.shape[1] % step
    padded = np.pad(values, ((0, rows), (0, cols), (0, 0)), mode="edge")
    shape = (padded.shape[0] // step, step, padded.shape[1] // step, step, values.shape[2])
    return np.asarray(padded.reshape(shape).mean(axis=(1, 3)), dtype=np.float32)

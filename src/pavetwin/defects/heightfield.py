"""A defect as one heightfield, in its own frame: everything drawn, labelled and measured is derived from it.

The defect's own frame has its centre at the origin, x along its length, y to the left and z up, in metres. Rows run
along y (row 0 at the smallest), columns along x.

The labelled region is derived from it by the rule of `Marking`. Its triangle mesh is dense where the surface is curved,
with the border exactly at the road's height.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import shapely
from shapely import Polygon

from pavetwin._core import relief_mesh, relief_outline, relief_region
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt32Array

SIMPLIFIED = 0.3
"""Tolerance of an outline against its mask's boundary [cells]."""


@dataclass(frozen=True, slots=True)
class Marking:
    """The labelled region: everything at least `least_m` below the road, widened by `margin_m` as an annotator's brush
    does, closed by a disc of `closing_m`, without holes; of that the largest connected region.

    Two parts of a crack stay connected across a gap of up to 2 √(margin² + 2 · margin · closing).
    """

    margin_m: float = 0.02
    closing_m: float = 0.05
    least_m: float = 0.0005


def mark(height_m: Float32Array, cell_m: float, marking: Marking) -> BoolArray:
    """The mask (rows, cols) of a heightfield."""
    return relief_region(height_m <= -marking.least_m, marking.margin_m / cell_m, marking.closing_m / cell_m)


def outline(mask: BoolArray, cell_m: float, origin_m: tuple[float, float]) -> Polygon:
    """The boundary of a connected mask without holes, in metres.

    Raises:
        ValueError: the mask is empty.
    """
    ring = relief_outline(mask)
    if len(ring) < 4:
        raise ValueError("an empty mask has no outline")
    whole = Polygon(ring * cell_m + origin_m)
    polygon = shapely.simplify(whole, SIMPLIFIED * cell_m, preserve_topology=False)
    if not (isinstance(polygon, Polygon) and polygon.is_valid):  # rare, and several times slower
        polygon = shapely.simplify(whole, SIMPLIFIED * cell_m)
    assert isinstance(polygon, Polygon)
    return polygon


Lattice = tuple[tuple[int, int], float, tuple[float, float]]

COARSEST_CELL_M = 0.005

FADE_M = (0.0, 0.012, 0.024, 0.036)
"""Distances from a notch at which what remains loses a share of its depth each."""


@dataclass(frozen=True, eq=False)
class Stains:
    """Appearance of a defect's surface besides its shape; fields (rows, cols) float32.

    Raises:
        ValueError: shapes differ, or a value is out of its range.
    """

    dirt: Float32Array
    """Dark fill and stains, 0 … 1: soil, damp, old bitumen."""
    dust: Float32Array
    """Pale fines, 0 … 1: abraded, or pumped out of the base."""
    stone: Float32Array
    """Share of the cell covered by loose stones."""
    tone: Float32Array
    """Brightness of an exposed stone, -1 … 1; 0 where the binder covers it."""

    def __post_init__(self) -> None:
        for name in ("dirt", "dust", "stone", "tone"):
            _check(name, getattr(self, name), self.dirt.shape, -1.0 if name == "tone" else 0.0)

    @classmethod
    def none(cls, shape: tuple[int, int]) -> Self:
        """A clean surface."""
        return cls(*(np.zeros(shape, dtype=np.float32) for _ in range(4)))


@dataclass(frozen=True, eq=False)
class Heightfield:
    """Height and surface of a defect, one value per square cell; all fields (rows, cols) float32 and read-only.

    A cell holds the *mean* over its square: a crack thinner than a cell has an `opening` below 1 and a height that is
    its depth times that share, so that areas and volumes are right and the width can be measured from the field.

    Raises:
        ValueError: shapes differ, a cell is coarser than 5 mm, or a share is not within 0 … 1.
    """

    height_m: Float32Array
    """Mean height above the defect-free road around it."""
    opening: Float32Array
    """Share of the cell that lies in an open crack."""
    exposed: Float32Array
    """Share that is broken: bare aggregate without binder."""
    cell_m: float
    origin_m: tuple[float, float]
    """Centre (x, y) of the cell [0, 0]."""
    marking: Marking
    """Rule for the labelled region."""
    paint: Callable[[], Stains]
    """Makes the stains, always the same. They are made on demand, as placement needs only the shapes."""

    def __post_init__(self) -> None:
        if not 0 < self.cell_m <= COARSEST_CELL_M:
            raise ValueError(f"a cell of {self.cell_m:g} m is not within 0 … {COARSEST_CELL_M} m")
        _check("height_m", self.height_m, self.height_m.shape, -np.inf, np.inf)
        _check("opening", self.opening, self.height_m.shape)
        _check("exposed", self.exposed, self.height_m.shape)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return int(self.height_m.shape[0]), int(self.height_m.shape[1])

    @property
    def lattice(self) -> Lattice:
        """Shape, cell and origin, as the kernels take them."""
        return self.shape, self.cell_m, self.origin_m

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """Least x, least y, largest x, largest y of its cells' squares."""
        (rows, cols), half = self.shape, self.cell_m / 2
        x, y = self.origin_m[0] - half, self.origin_m[1] - half
        return x, y, x + cols * self.cell_m, y + rows * self.cell_m

    @cached_property
    def mask(self) -> BoolArray:
        """(rows, cols) the label mask: one region without holes; see `Marking` for the rule."""
        mask = mark(self.height_m, self.cell_m, self.marking)
        mask.flags.writeable = False
        return mask

    @cached_property
    def outline(self) -> Polygon:
        """The mask's boundary in the defect's own frame."""
        return outline(self.mask, self.cell_m, self.origin_m)

    @cached_property
    def stains(self) -> Stains:
        """Dirt, dust and stones; stones only within the mask."""
        stains = self.paint()
        if stains.dirt.shape != self.shape:
            raise ValueError(f"stains of shape {stains.dirt.shape} on a heightfield of {self.shape}")
        kept = self.mask.astype(np.float32)
        return replace(stains, stone=stains.stone * kept, tone=stains.tone * kept)

    def uv(self, xy: Float64Array) -> Float32Array:
        """Texture coordinates (n, 2) of points (n, 2): (0, 0) is the outer corner of cell [0, 0], v grows with y."""
        x0, y0, x1, y1 = self.bounds_m
        return np.asarray((xy - (x0, y0)) / (x1 - x0, y1 - y0), dtype=np.float32)

    def without(self, ring: Float64Array) -> Self:
        """The field with the defect-free road within a ring (n, 2), own frame; what remains fades out before it."""
        notch = Polygon(ring)
        (rows, cols), (x0, y0) = self.shape, self.origin_m
        x, y = np.meshgrid(x0 + self.cell_m * np.arange(cols), y0 + self.cell_m * np.arange(rows))
        kept = np.zeros(self.shape, dtype=np.float32)
        for away_m in FADE_M:
            kept += ~shapely.contains_xy(notch.buffer(away_m, quad_segs=4), x, y) / np.float32(len(FADE_M))
        fields = {name: getattr(self, name) * kept for name in ("height_m", "opening", "exposed")}
        return replace(self, **fields).settled()

    def settled(self) -> Self:
        """The field with the defect-free road outside its mask: height 0 and nothing broken there; stains and dust
        stay."""
        kept = self.mask.astype(np.float32)
        result = replace(self, height_m=self.height_m * kept, opening=self.opening * kept, exposed=self.exposed * kept)
        apart = (self.height_m <= -self.marking.least_m) & ~self.mask
        if apart.any():  # a removed region may have changed the mask
            return result.settled()
        result.__dict__["mask"] = self.mask  # consists of the same cells
        return result


def _check(name: str, layer: Float32Array, shape: tuple[int, ...], low: float = 0.0, high: float = 1.0) -> None:
    if layer.ndim != 2 or layer.shape != shape or layer.dtype != np.float32:
        raise ValueError(f"{name} is {layer.dtype} of shape {layer.shape}, not float32 {shape}")
    if layer.size and not (layer.min() >= low and layer.max() <= high):
        raise ValueError(f"{name} is not within {low:g} … {high:g}")
    layer.flags.writeable = False


TOLERANCE_M = 0.002
MOST_VERTICES = 20_000


@dataclass(frozen=True, eq=False)
class DefectMesh:
    """Triangles over a defect's outline, anticlockwise from above, in the defect's own frame."""

    positions: Float32Array
    """(n, 3) metres. The first `border` of them are the outline's corners in its order, at z = 0."""
    uv: Float32Array
    """(n, 2) into the heightfield's maps; see `Heightfield.uv`."""
    indices: UInt32Array
    """(m, 3)."""
    border: int


def mesh_of(
    heightfield: Heightfield, tolerance_m: float = TOLERANCE_M, most_vertices: int = MOST_VERTICES
) -> DefectMesh:
    """A mesh that is within `tolerance_m` of the heightfield everywhere, or has `most_vertices`.

    Its border is the defect's outline, so it fits a hole that is cut into the road along that polygon.

    Raises:
        ValueError: the tolerance is not positive.
    """
    if tolerance_m <= 0:
        raise ValueError(f"a tolerance of {tolerance_m:g} m is not positive")
    ring = np.ascontiguousarray(np.asarray(heightfield.outline.exterior.coords)[:-1])
    made = relief_mesh(heightfield.lattice, heightfield.height_m, ring, tolerance_m, most_vertices)
    if made is None:
        raise ValueError("the outline crosses itself")
    positions, indices, _ = made
    uv = heightfield.uv(positions[:, :2].astype(np.float64))
    return DefectMesh(positions, uv, indices, len(ring))

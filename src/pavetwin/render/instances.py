"""Instanced meshes as rows of a table: gathered from tiles and traffic, then culled and sorted together."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import (
    BoolArray,
    Float16Array,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    StructuredArray,
    UInt32Array,
)
from pavetwin.scene.coarser import foliage_px2, mean_area_m2
from pavetwin.scene.models import BODY, FAR, SHADOW
from pavetwin.scene.shafts import THIN
from pavetwin.scene.values import Instance, Mesh, Model

_LOWEST_SHADE_M: Final = 0.35
"""Lower objects have no contact shadow worth drawing; objects whose underside is higher do not touch the ground [m]."""

_FOOT_M: Final = 1.0  # The part of an object below this height is its footprint: of a tree the trunk without its boughs
_WIDE_M: Final = 1.2
_SHADE_REACH_M: Final = 1.8
_SLIM_REACH_M: Final = 0.5
"""Reach of contact shadows around cars, and around people and posts; the cost grows with the area [m]."""

RECORD: Final = np.dtype(
    [
        ("rows", "f4", (3, 4)),
        ("tints", "f2", (4, 4)),
        ("label", "u4"),
        ("velocity", "f4", 3),
        ("shift", "f4", 4),
    ]
)
"""Layout of one instance record, as the shaders read it."""

LAYOUT: Final = {
    "array_stride": RECORD.itemsize,
    "step_mode": "instance",
    "attributes": [
        *({"format": "float32x4", "offset": 16 * row, "shader_location": row} for row in range(3)),
        *({"format": "float16x4", "offset": 48 + 8 * tint, "shader_location": 3 + tint} for tint in range(4)),
        {"format": "uint32", "offset": 80, "shader_location": 7},
        {"format": "float32x3", "offset": 84, "shader_location": 8},
        {"format": "float32x4", "offset": 96, "shader_location": 9},
    ],
}


class PartTable:
    """Index and size of every part of every model."""

    def __init__(self, models: Mapping[str, Model]) -> None:
        names = [(model.name, part) for model in models.values() for part in model.parts]
        self.number = {name: index for index, name in enumerate(names)}
        self.meshes = [models[model].parts[part] for model, part in names]
        bodies = {number: models[model].parts for (model, part), number in self.number.items() if part == BODY}
        self.shadow = {number: parts[SHADOW] for number, parts in bodies.items() if SHADOW in parts}
        """Meshes that cast the shadow of a body, by its number."""
        self.far = {number: parts[FAR] for number, parts in bodies.items() if FAR in parts}
        """Meshes for a body that is far away, by its number."""
        self.single_sided = frozenset(self.far)
        """Parts of which only front faces are seen; these are made with all their triangles facing outwards."""
        self.casts = np.array([THIN not in models[model].extras for model, _ in names], dtype=np.bool_)
        """Parts that are in shadow maps and have contact shadows."""
        boxes = [(mesh.positions.min(axis=0), mesh.positions.max(axis=0)) for mesh in self.meshes]
        self.least_px2 = np.array([foliage_px2(mesh) for mesh in self.meshes], dtype=np.float64)
        self.area_m2 = np.array([mean_area_m2(mesh) for mesh in self.meshes], dtype=np.float64)
        self.low = np.array([low for low, _ in boxes], dtype=np.float64).reshape(-1, 3)
        self.high = np.array([high for _, high in boxes], dtype=np.float64).reshape(-1, 3)
        feet = [_footprint(mesh) for mesh in self.meshes]
        self.foot_low = np.array([low for low, _ in feet], dtype=np.float64).reshape(-1, 2)
        self.foot_high = np.array([high for _, high in feet], dtype=np.float64).reshape(-1, 2)


def _footprint(mesh: Mesh) -> tuple[Float32Array, Float32Array]:
    """Bounds of what touches the ground, or of the whole mesh if nothing does."""
    low = mesh.positions[:, 2] < _FOOT_M
    points = mesh.positions[low if low.any() else slice(None), :2]
    return points.min(axis=0), points.max(axis=0)


@dataclass(frozen=True)
class InstanceBatch:
    """n instances. Positions are in the world frame, metres."""

    part: Int32Array
    """(n,)"""
    transform: Float64Array
    """(n, 3, 4)"""
    tints: Float16Array
    """(n, 4, 4)"""
    label: UInt32Array
    """(n,)"""
    velocity: Float64Array
    """(n, 3)"""
    centre: Float64Array
    """(n, 3) of the sphere around it."""
    radius: Float64Array
    """(n,)"""

    @classmethod
    def of(
        cls, instances: Sequence[Instance], parts: PartTable, velocities: Mapping[int, npt.ArrayLike] | None = None
    ) -> "InstanceBatch":
        """The batch of some instances."""
        count, moving = len(instances), velocities or {}
        part = np.array([parts.number[each.model, each.part] for each in instances], dtype=np.int32)
        transform = np.array([each.transform[:3] for each in instances], dtype=np.float64).reshape(count, 3, 4)
        middle, half = (parts.low[part] + parts.high[part]) / 2, (parts.high[part] - parts.low[part]) / 2
        stretch = np.linalg.norm(transform[:, :, :3], axis=1)
        return cls(
            part,
            transform,
            np.array([each.tints for each in instances], dtype=np.float16).reshape(count, 4, 4),
            np.array([each.label for each in instances], dtype=np.uint32),
            np.array([moving.get(each.label, (0, 0, 0)) for each in instances], dtype=np.float64).reshape(count, 3),
            np.einsum("nij,nj->ni", transform[:, :, :3], middle) + transform[:, :, 3],
            np.linalg.norm(half * stretch, axis=1),
        )

    @classmethod
    def joined(cls, batches: Iterable["InstanceBatch"]) -> "InstanceBatch":
        """Several batches as one."""
        every = list(batches)
        return cls(*(np.concatenate([getattr(batch, column.name) for batch in every]) for column in fields(cls)))

    def __len__(self) -> int:
        return len(self.part)

    def only(self, which: BoolArray | Int64Array | slice) -> "InstanceBatch":
        """The selected rows."""
        return InstanceBatch(*(getattr(self, column.name)[which] for column in fields(self)))


def instance_rows(batch: InstanceBatch, camera: Float64Array) -> StructuredArray:
    """(n,) `RECORD` of a batch; `camera` (3,) in the world frame, metres."""
    rows = np.zeros(len(batch), dtype=RECORD)
    rows["rows"] = batch.transform
    rows["rows"][:, :, 3] = batch.transform[:, :, 3] - camera
    rows["tints"], rows["label"] = batch.tints, batch.label
    rows["velocity"], rows["shift"] = batch.velocity, (1, 1, 0, 0)
    return rows


@dataclass
class InstanceBuffer:
    """The instance buffer of one frame while it is filled. Positions are relative to the camera."""

    camera: Float64Array
    """(3,) world frame, metres."""
    filled: list[StructuredArray] = field(default_factory=list)
    count: int = 0

    def add_place(self, origin: tuple[float, float], *, label: int = 0) -> int:
        """Add a record for a mesh in the frame of a tile; returns its index."""
        row = np.zeros(1, dtype=RECORD)
        row["rows"][0, :, :3] = np.eye(3)
        row["rows"][0, :, 3] = np.array([*origin, 0.0]) - self.camera
        row["tints"] = 1
        row["label"] = label
        row["shift"] = (1, 1, 0, 0)
        return self._add(row)

    def add_batch(
        self, batch: InstanceBatch, level: Int64Array | None = None
    ) -> list[tuple[tuple[int, int], int, int]]:
        """Add a batch, sorted by part and level; returns ((part, level), count, index of the first record)."""
        if len(batch) == 0:
            return []
        sort = batch.part.astype(np.int64) * 16 + (0 if level is None else level)
        order = np.argsort(sort, kind="stable")
        first = self._add(instance_rows(batch.only(order), self.camera))
        kinds, starts, counts = np.unique(sort[order], return_index=True, return_counts=True)
        return [
            ((int(kind) // 16, int(kind) % 16), int(count), first + int(start))
            for kind, start, count in zip(kinds, starts, counts, strict=True)
        ]

    def add_shades(self, batch: InstanceBatch, parts: PartTable) -> tuple[int, int]:
        """Add records of the sky that a batch hides from the ground; returns their count and the first one's index."""
        low, high = parts.low[batch.part], parts.high[batch.part]
        loose = parts.least_px2[batch.part] > 0
        low[:, :2] = np.where(loose[:, None], low[:, :2], parts.foot_low[batch.part])
        high[:, :2] = np.where(loose[:, None], high[:, :2], parts.foot_high[batch.part])
        stands = (high[:, 2] > _LOWEST_SHADE_M) & ((low[:, 2] < _LOWEST_SHADE_M) | loose)
        batch, low, high, loose = batch.only(np.flatnonzero(stands)), low[stands], high[stands], loose[stands]
        wide = np.minimum(high[:, 0] - low[:, 0], high[:, 1] - low[:, 1]) > _WIDE_M
        rows = np.zeros(len(batch), dtype=RECORD)
        rows["rows"] = batch.transform
        rows["rows"][:, :, 3] = batch.transform[:, :, 3] - self.camera
        rows["tints"][:, 0, :2] = (low[:, :2] + high[:, :2]) / 2
        # People and posts are slimmer than the boxes around their arms.
        rows["tints"][:, 0, 2:] = (high[:, :2] - low[:, :2]) / 2 * np.where(wide | loose, 1.0, 0.5)[:, None]
        rows["tints"][:, 1, 0], rows["tints"][:, 1, 2] = high[:, 2], loose
        # Wheels hold a car up by a seventh of its height; what has no wheels stands on the ground.
        rows["tints"][:, 1, 1] = np.where(loose, low[:, 2], np.where(wide, high[:, 2] / 7, 0.0))
        reach = np.where(wide, np.minimum(high[:, 2], _SHADE_REACH_M), _SLIM_REACH_M)
        rows["tints"][:, 1, 3] = np.where(loose, 0.5 * high[:, 0], reach)
        return len(rows), self._add(rows)

    def add_strips(self, strips: Float64Array) -> tuple[int, int]:
        """Add records of strips of ground (n, 8) that wires and twigs shade; returns their count and the first one."""
        rows = np.zeros(len(strips), dtype=RECORD)
        rows["rows"][:, 0, :3], rows["rows"][:, 0, 3] = strips[:, :3] - self.camera, strips[:, 6]
        rows["rows"][:, 1, :3], rows["rows"][:, 1, 3] = strips[:, 3:6] - self.camera, strips[:, 7] - self.camera[2]
        return len(rows), self._add(rows)

    def _add(self, rows: StructuredArray) -> int:
        self.filled.append(rows)
        first, self.count = self.count, self.count + len(rows)
        return first

    @property
    def data(self) -> StructuredArray:
        return np.concatenate(self.filled)

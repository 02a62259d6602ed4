"""Making defects: as placement needs them, and with everything that a renderer needs."""

from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Kind, Line, Size, median_s
from pavetwin.defects import albedo_factor, heightfield_of, kinds, measure, mesh_of, normal_map, occlusion_map
from pavetwin.defects.heightfield import Heightfield
from pavetwin.world.model import World

PLACED_TARGET_S, WHOLE_TARGET_S = 0.005, 0.060


def lines(world: World, size: Size) -> Iterator[Line]:
    """Mean cost of a defect, weighted as the classes are in a world."""
    weights = np.array([kind.weight for kind in kinds()])
    rng = np.random.default_rng(0)
    chosen = [
        (kinds()[k], int(seed))
        for k, seed in zip(_dealt(weights, size.shapes), rng.integers(2**32, size=size.shapes), strict=True)
    ]

    def shaped() -> None:
        for kind, seed in chosen:
            shape = kind.generate(np.random.default_rng(seed))
            measure(shape)

    def whole() -> None:
        for kind, seed in chosen:
            _derived(kind.generate(np.random.default_rng(seed)))

    note = f"mean of {size.shapes}, classes mixed as in a world; shape, mask, outline and measures"
    yield Line(
        "a defect, as placement needs it",
        median_s(shaped, size.runs) / size.shapes,
        Kind.SECONDS,
        PLACED_TARGET_S,
        note=note,
    )
    note = "the same with mesh, normals, albedo and occlusion"
    yield Line(
        "a defect with all that is drawn",
        median_s(whole, size.runs) / size.shapes,
        Kind.SECONDS,
        WHOLE_TARGET_S,
        note=note,
    )
    again = world.defects[:: max(1, len(world.defects) // size.shapes)]
    took_s = median_s(lambda: [heightfield_of(defect) for defect in again], size.runs)
    yield Line("a placed defect, regenerated from its seed", took_s / len(again), Kind.SECONDS)


def _dealt(weights: np.ndarray[tuple[int], np.dtype[np.float64]], count: int) -> list[int]:
    """Indices of classes, `count` of them, in proportion to their weights."""
    ends = np.cumsum(weights / weights.sum())
    return [int(np.searchsorted(ends, (index + 0.5) / count)) for index in range(count)]


def _derived(shape: Heightfield) -> None:
    measure(shape)
    mesh_of(shape)
    normal_map(shape)
    albedo_factor(shape)
    occlusion_map(shape)

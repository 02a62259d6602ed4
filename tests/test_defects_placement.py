"""Defects lie whole on their segment, apart from each other, and depend on their own segment alone."""

from collections import Counter

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.config.base import Settings
from pavetwin.defects import DefectOptions, kind_of, kinds, place, register, sample_points
from pavetwin.defects.crocodile_crack import crocodile_crack
from pavetwin.defects.pothole import PotholeParameters, pothole
from pavetwin.defects.single_crack import SingleCrackParameters, single_crack
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import DefectClass
from scenes import built

seeds = st.integers(0, 2**32 - 1)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name.value)
def test_every_class_draws_a_plain_outline_around_the_origin(kind) -> None:  # type: ignore[no-untyped-def]
    for seed in range(60):
        outline = kind.outline(rng(seed))
        assert outline.is_valid
        assert outline.area > 0
        assert not outline.interiors
        assert outline.distance(shapely.Point(0, 0)) < 0.05
        assert shapely.equals_exact(outline, kind.outline(rng(seed))), "the same seed gives the same outline"


@given(seeds)
def test_single_cracks_are_as_long_and_wide_as_asked(seed: int) -> None:
    outline = single_crack(rng(seed), SingleCrackParameters(length_m=(2.0, 2.0), width_m=(0.01, 0.02)))
    x, y = shapely.minimum_rotated_rectangle(outline).exterior.xy
    assert 1.9 <= max(np.hypot(np.diff(x), np.diff(y))) <= 2.8
    assert 0.003 <= outline.area / (outline.length / 2) <= 0.021, "mean opening"


@given(seeds)
def test_potholes_and_crocodile_cracks_have_their_sizes(seed: int) -> None:
    low_x, low_y, high_x, high_y = shapely.minimum_rotated_rectangle(crocodile_crack(rng(seed))).bounds
    assert min(high_x - low_x, high_y - low_y) >= 1.2
    assert max(high_x - low_x, high_y - low_y) <= 4.5
    hole = pothole(rng(seed), PotholeParameters(diameter_m=(0.25, 1.0)))
    assert 0.15 <= shapely.minimum_bounding_radius(hole) * 2 <= 1.25


def test_thirty_on_every_segment_whole_and_apart() -> None:
    world = built("cross").world
    defects = place(world.segments, seed=3)
    counts = Counter(defect.segment for defect in defects)
    assert all(27 <= counts[segment.id] <= 30 for segment in world.segments)
    assert [defect.id for defect in defects] == list(range(len(defects)))
    for segment in world.segments:
        own = [defect for defect in defects if defect.segment == segment.id]
        assert all(segment.polygon.contains(defect.polygon) for defect in own)
        assert all(defect.polygon.distance(defect.centre) < 0.05 for defect in own)
        tree = shapely.STRtree([defect.polygon for defect in own])
        pairs = tree.query([defect.polygon for defect in own], "dwithin", distance=0.09)
        assert pairs.shape[1] == len(own)
        assert sum(defect.polygon.area for defect in own) <= 0.15 * segment.area_m2 + 1e-9


def test_a_segment_elsewhere_changes_nothing_here() -> None:
    segments = built("cross").world.segments
    alone = [replaced.polygon for replaced in place(segments[4:5], seed=3)]
    among = [defect.polygon for defect in place(segments, seed=3) if defect.segment == segments[4].id]
    assert alone == among


def test_seeds_differ_and_zero_is_a_seed() -> None:
    segments = built("cross").world.segments[:2]
    zero, one = place(segments, seed=0), place(segments, seed=1)
    assert zero == place(segments, seed=0)
    assert zero != one


def test_density_and_mix_are_configurable() -> None:
    segments = built("cross").world.segments
    assert place(segments, 1, DefectOptions(per_segment=0)) == ()
    potholes = place(segments, 1, DefectOptions(per_segment=5, mix={"pothole": 1.0}))
    assert {defect.kind for defect in potholes} == {DefectClass.POTHOLE}
    assert len(potholes) == 5 * len(segments)
    with pytest.raises(PaveTwinError, match="did you mean 'pothole'"):
        place(segments, 1, DefectOptions(mix={"pothol": 1.0}))
    with pytest.raises(PaveTwinError, match="per_segment"):
        DefectOptions.parse({"per_segment": -1}, where="test")
    with pytest.raises(PaveTwinError, match="unknown key 'per_segmen'"):
        DefectOptions.parse({"per_segmen": 1}, where="test")


def test_a_class_is_registered_once() -> None:
    with pytest.raises(ValueError, match="registered already"):
        register(DefectClass.POTHOLE, pothole, weight=1.0)
    assert kind_of("pothole").outline is pothole
    with pytest.raises(PaveTwinError, match="did you mean 'pothole'"):
        kind_of("potholes")


@pytest.mark.parametrize("kind", ["single_crack", "crocodile_crack", "pothole"])
def test_sample_points_stand_for_equal_shares_of_the_area(kind: str) -> None:
    segments = built("cross").world.segments[:3]
    for defect in place(segments, 5, DefectOptions(per_segment=6, mix={kind: 1.0})):
        points = sample_points(defect, 200)
        assert points.shape == (200, 2)
        assert shapely.contains_xy(defect.polygon.buffer(1e-6), points).all()
        assert np.array_equal(points, sample_points(defect, 200))
        low_x, low_y, high_x, high_y = defect.polygon.bounds
        half = shapely.box(low_x, low_y, (low_x + high_x) / 2, high_y)
        share = defect.polygon.intersection(half).area / defect.polygon.area
        assert np.mean(points[:, 0] <= half.bounds[2]) == pytest.approx(share, abs=0.08)
    with pytest.raises(ValueError, match="0 points"):
        sample_points(defect, 0)


def test_parameters_are_checked() -> None:
    assert issubclass(PotholeParameters, Settings)
    with pytest.raises(PaveTwinError, match="smaller first"):
        PotholeParameters.parse({"diameter_m": (1.0, 0.5)}, where="test")

"""Defects lie whole on their segment, apart from each other, and depend on their own segment alone."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from pavetwin.defects import (
    DEFECT_CLASSES,
    DefectOptions,
    Heightfield,
    Marking,
    Stains,
    add_defects,
    defect_class,
    heightfield_of,
    measure,
    place,
    placed_on,
    sample_points,
)
from pavetwin.defects import placement as placed
from pavetwin.defects.placement import APART_M
from pavetwin.defects.poses import RoadSection, wheel_paths
from pavetwin.defects.poses import poses as placed_poses
from pavetwin.defects.pothole import pothole, sample_pothole_poses
from pavetwin.defects.registry import DefectKind
from pavetwin.defects.severity import pothole_severity
from pavetwin.defects.shapes import turned
from pavetwin.errors import PaveTwinError
from pavetwin.experiments import fly_unit
from pavetwin.mission.inputs import defects_of
from pavetwin.mission.spec import DefectInput
from pavetwin.workers import started
from pavetwin.world.cache import cache_folder
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import Defect, World
from pavetwin.world.store import load_world, save_world
from scenes import built, tiny


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_thirty_on_every_segment_whole_and_apart() -> None:
    segments = built("cross").world.segments[:4]
    defects = place(segments, 3, DefectOptions(population="paper"))
    counts = Counter(defect.segment for defect in defects)
    assert all(24 <= counts[segment.id] <= 30 for segment in segments)
    assert [defect.id for defect in defects] == list(range(len(defects)))
    for segment in segments:
        own = [defect for defect in defects if defect.segment == segment.id]
        assert all(segment.polygon.contains(defect.polygon) for defect in own)
        assert all(defect.polygon.envelope.contains(defect.centre) for defect in own)
        tree = shapely.STRtree([defect.polygon for defect in own])
        pairs = tree.query([defect.polygon for defect in own], "dwithin", distance=0.09)
        assert pairs.shape[1] == len(own)
        assert sum(defect.polygon.area for defect in own) <= 0.15 * segment.area_m2 + 1e-9


def test_a_segment_elsewhere_changes_nothing_here() -> None:
    segments, few = built("cross").world.segments, DefectOptions(population="paper", per_segment=4)
    alone = [replaced.polygon for replaced in place(segments[4:5], 3, few)]
    among = [defect.polygon for defect in place(segments[2:6], 3, few) if defect.segment == segments[4].id]
    assert alone == among


def test_the_number_of_threads_changes_nothing() -> None:
    segments, few = built("cross").world.segments[:5], DefectOptions(population="paper", per_segment=5)
    shares: list[float] = []
    alone = place(segments, 7, few, shares.append, threads=1)
    assert shares == [0.2, 0.4, 0.6, 0.8, 1.0]
    assert place(segments, 7, few, threads=3) == alone == place(segments, 7, few)


def test_processes_place_the_same_as_threads() -> None:
    segments, few = built("cross").world.segments[:5], DefectOptions(population="paper", per_segment=5)
    shares: list[float] = []
    with started(2) as waiting:
        apart = place(segments, 7, few, shares.append, waiting=waiting)
        assert all(each.process._closed for each in waiting), "they placed them"  # type: ignore[attr-defined]
    assert shares == [0.2, 0.4, 0.6, 0.8, 1.0]
    assert apart == place(segments, 7, few)


def test_classes_of_the_users_own_are_placed_here(monkeypatch: pytest.MonkeyPatch) -> None:
    segments, few = built("cross").world.segments[:2], DefectOptions(population="paper", per_segment=2)
    monkeypatch.setattr(DefectKind, "ships", False)
    with started(1) as waiting:
        assert place(segments, 7, few, waiting=waiting)
        assert waiting[0].process.is_alive(), "it was not asked"


def test_seeds_differ_and_zero_is_a_seed() -> None:
    segments = built("cross").world.segments[:2]
    few = DefectOptions(population="paper", per_segment=4)
    zero, one = place(segments, 0, few), place(segments, 1, few)
    assert zero == place(segments, 0, few)
    assert zero != one


def test_density_and_mix_are_configurable() -> None:
    segments = built("cross").world.segments
    assert place(segments, 1, DefectOptions(population="paper", per_segment=0)) == ()
    potholes = place(segments, 1, DefectOptions(population="paper", per_segment=5, mix={"pothole": 1.0}))
    assert {defect.kind for defect in potholes} == {"pothole"}
    assert len(potholes) == 5 * len(segments)
    with pytest.raises(PaveTwinError, match="did you mean 'pothole'"):
        place(segments, 1, DefectOptions(mix={"pothol": 1.0}))
    with pytest.raises(PaveTwinError, match="per_segment"):
        DefectOptions.parse({"per_segment": -1}, where="test")
    with pytest.raises(PaveTwinError, match="unknown key 'per_segmen'"):
        DefectOptions.parse({"per_segmen": 1}, where="test")


def test_density_by_area_holds_on_average() -> None:
    segments = built("cross").world.segments
    area = sum(segment.area_m2 for segment in segments)
    counts = [
        len(place(segments, seed, DefectOptions(population="paper", per_100_m2=0.7, mix={"pothole": 1})))
        for seed in range(3)
    ]
    assert np.mean(counts) == pytest.approx(0.7 * area / 100, rel=0.15)
    with pytest.raises(PaveTwinError, match="either per_segment or per_100_m2"):
        DefectOptions.parse({"per_segment": 3, "per_100_m2": 1.0}, where="test")


def test_a_placed_defect_is_its_heightfield_turned_and_moved() -> None:
    for defect in place(built("cross").world.segments[:2], 8, DefectOptions(population="paper", per_segment=8)):
        shape = heightfield_of(defect)
        ring = turned(np.asarray(shape.outline.exterior.coords)[:-1], defect.yaw_rad)
        moved = shapely.Polygon(ring + np.array([defect.centre.x, defect.centre.y]))
        assert moved.symmetric_difference(defect.polygon).area < 1e-4 * moved.area
        sizes, kind = measure(shape), DEFECT_CLASSES.get(defect.kind)
        assert defect.severity is kind.rate(sizes)
        assert defect.width_m == pytest.approx(kind.width(sizes), abs=1e-5)
        assert defect.depth_m == pytest.approx(sizes.depth_m, abs=1e-5)
        assert defect.length_m == pytest.approx(sizes.crack_length_m, abs=1e-3), (
            "of a pothole too, those that leave its rim"
        )
        assert defect.area_m2 == pytest.approx(sizes.area_m2, rel=1e-4)


STREET = RoadSection(length_m=100.0, width_m=7.0, lanes=2)


def poses(kind: str, count: int = 400) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.concatenate([DEFECT_CLASSES.get(kind).sample_poses(rng(seed), STREET, 5) for seed in range(count)])


def test_crocodile_cracks_lie_along_wheel_paths_and_potholes_mostly_in_them() -> None:
    paths = np.array([-2.57, -0.93, 0.93, 2.57])

    def in_path(offsets: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        return float((np.abs(offsets[:, None] - paths).min(axis=1) < 0.3).mean())

    crocodiles = poses("crocodile_crack")
    assert in_path(crocodiles[:, 1]) > 0.98
    assert np.abs(np.sin(crocodiles[:, 2])).max() < 0.25
    assert 0.6 < in_path(poses("pothole")[:, 1]) < 0.95
    assert (np.abs(poses("pothole")[:, 1]) < 3.5).all()


def test_single_cracks_run_along_across_and_obliquely() -> None:
    turns = np.abs(np.sin(poses("single_crack", 1500)[:, 2]))
    assert np.mean(turns < 0.2) == pytest.approx(0.40, abs=0.06)
    assert np.mean(turns > 0.93) == pytest.approx(0.35, abs=0.06)


def test_wheel_paths_stay_on_narrow_roads() -> None:
    offsets = wheel_paths(rng(1), RoadSection(length_m=50.0, width_m=2.6, lanes=2), 500)
    assert np.abs(offsets).max() < 1.3
    assert set(np.sign(offsets)) == {-1.0, 1.0}


def dent(generator: np.random.Generator) -> Heightfield:
    """A class of one's own: a dish a hand wide."""
    radius = float(generator.uniform(0.08, 0.12))
    at = 0.005 * np.arange(-40, 41)
    height = np.minimum(0.2 * (np.hypot(at, at[:, None]) - radius), 0).astype(np.float32)
    whole = np.zeros_like(height)
    origin = (float(at[0]), float(at[0]))
    return Heightfield(height, whole, whole, 0.005, origin, Marking(), lambda: Stains.none((81, 81))).settled()


@pytest.fixture
def dents() -> Iterator[None]:
    defect_class(
        "dent",
        sample_poses=lambda rng, road, count: placed_poses(rng, wheel_paths(rng, road, count), 0.0, 1.0),
        rate=pothole_severity,
        width=lambda sizes: sizes.diameter_m,
        weight=1.0,
    )(dent)
    yield
    DEFECT_CLASSES.restore("dent", None)


@pytest.mark.usefixtures("dents")
def test_a_fourth_class_is_placed_stored_drawn_and_generated_again(tmp_path: Path) -> None:
    from pavetwin.draw.world_html import save_world_html
    from pavetwin.draw.world_map import legend

    made = add_defects(built("cross"), DefectOptions(population="paper", per_segment=3, mix={"dent": 1.0}))
    assert {str(defect.kind) for defect in made.world.defects} == {"dent"}
    saved = save_world(made, tmp_path / "dented")
    read = load_world(tmp_path / "dented")
    assert read.defects == saved.defects
    first = read.defects[0]
    assert first.kind == "dent"
    assert 0.15 < first.width_m < 0.25
    assert measure(heightfield_of(first)).depth_m == pytest.approx(first.depth_m, abs=1e-5)
    assert [entry.label for entry in legend(read)][-1] == "dent"
    page = tmp_path / "page.html"
    save_world_html(read, page)
    assert "data-kind='dent'" in page.read_text(encoding="utf-8")


def test_a_class_is_registered_once() -> None:
    with pytest.raises(ValueError, match="registered already"):
        defect_class(
            "pothole",
            sample_poses=sample_pothole_poses,
            rate=pothole_severity,
            width=lambda sizes: sizes.diameter_m,
            weight=1.0,
        )(dent)
    with pytest.raises(ValueError, match="Pot hole"):
        defect_class(
            "Pot hole", sample_poses=sample_pothole_poses, rate=pothole_severity, width=lambda _: 0.0, weight=1.0
        )(dent)
    assert DEFECT_CLASSES.get("pothole").generate is pothole
    with pytest.raises(PaveTwinError, match="did you mean 'pothole'"):
        DEFECT_CLASSES.get("potholes")


@pytest.mark.parametrize("kind", ["single_crack", "crocodile_crack", "pothole"])
def test_sample_points_stand_for_equal_shares_of_the_area(kind: str) -> None:
    segments = built("cross").world.segments[:3]
    for defect in place(segments, 5, DefectOptions(population="paper", per_segment=6, mix={kind: 1.0})):
        points = sample_points(defect, 200)
        assert points.shape == (200, 2)
        assert shapely.contains_xy(defect.polygon.buffer(0.0051), points).all()
        assert np.array_equal(points, sample_points(defect, 200))
        low_x, low_y, high_x, high_y = defect.polygon.bounds
        half = shapely.box(low_x, low_y, (low_x + high_x) / 2, high_y)
        share = defect.polygon.intersection(half).area / defect.polygon.area
        assert np.mean(points[:, 0] <= half.bounds[2]) == pytest.approx(share, abs=0.08)
    with pytest.raises(ValueError, match="0 points"):
        sample_points(defect, 0)


OPTIONS = DefectOptions(population="paper", per_segment=3)
STREETS = [tiny.street(name, (0.0, y), (30.0, y)) for name, y in (("one", 0.0), ("two", 50.0))]


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    """Two streets with a content hash, as every world has that was built, and an empty cache."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return replace(tiny.world(STREETS, ()), content_hash="5")


def values(defects: Sequence[Defect]) -> list[object]:
    rows = [[getattr(each, field.name) for field in fields(each)] for each in defects]
    return [[getattr(value, "wkb", value) for value in row] for row in rows]


def files() -> list[Path]:
    return list(cache_folder("defects").iterdir()) if cache_folder("defects").is_dir() else []


def test_a_second_process_reads_the_same_to_the_bit(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    first = placed_on(world, world.segments, 7, OPTIONS)
    assert values(first) == values(place(world.segments, 7, OPTIONS))
    assert len(files()) == 1
    monkeypatch.setattr(placed, "place", lambda *_, **__: pytest.fail("placed, and not read from the cache"))
    found = placed_on(world, world.segments, 7, OPTIONS, threads=1)
    assert values(found) == values(first)
    assert all(type(a.severity) is type(b.severity) for a, b in zip(found, first, strict=True))


def test_other_inputs_are_other_files(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(placed, "place", lambda *_, **__: ())

    def file_of(world: World, seed: int = 7, options: DefectOptions = OPTIONS, count: int = 2) -> str:
        before = set(files())
        placed_on(world, world.segments[:count], seed, options)
        return str({*files()} - before)

    names = [
        file_of(world),
        file_of(world, seed=8),
        file_of(world, count=1),
        file_of(world, options=DefectOptions(population="survey")),
        file_of(replace(world, content_hash="6")),
    ]
    monkeypatch.setattr(placed, "made_by", lambda *_: "by other code")
    names.append(file_of(world))
    assert len({*names}) == len(names) == len(files())


def test_nothing_is_kept_of_a_world_without_a_hash_or_of_classes_of_a_users_own(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    placed_on(replace(world, content_hash=""), world.segments[:1], 7, OPTIONS)
    monkeypatch.setattr(DefectKind, "ships", False)
    monkeypatch.setattr(placed, "place", lambda *_, **__: ())
    placed_on(world, world.segments[:1], 7, OPTIONS)
    assert not files()


def test_missions_and_studies_find_theirs_there(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    place_of_unit = fly_unit._Place("a.yaml", world.content_hash, (0,), 7, OPTIONS.model_dump_json())
    monkeypatch.setattr(fly_unit, "world_of_study", lambda *_: world)
    source = DefectInput(seed=7, options=OPTIONS)
    first = [defects_of(world, source), fly_unit._defects.__wrapped__(place_of_unit)]
    assert len(files()) == 2
    monkeypatch.setattr(placed, "place", lambda *_, **__: pytest.fail("placed, and not read from the cache"))
    again = [defects_of(world, source), fly_unit._defects.__wrapped__(place_of_unit)]
    assert [*map(values, again)] == [*map(values, first)]


BROKEN = """
title: potholes in networks
density: {per_100_m2: 2}
classes:
  crocodile_crack:
    weight: 1
    sizes: {length_m: {median: 1.4, least: 1.4, most: 1.4}, width_m: {median: 1.1, least: 1.1, most: 1.1}}
  pothole:
    weight: 1
    sizes: {diameter_m: {median: 0.3, least: 0.3, most: 0.3}}
    within: {crocodile_crack: 1.0}
"""


@pytest.fixture(scope="module")
def population(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("population") / "broken.yaml"
    file.write_text(BROKEN)
    return str(file)


@pytest.fixture(scope="module")
def broken(population: str) -> World:
    town = built("cross").world
    return replace(town, defects=place(town.segments[:1], 5, DefectOptions(population=population)))


def hosts(world: World) -> list[Defect]:
    return [defect for defect in world.defects if defect.notch]


def test_potholes_lie_within_networks_and_outlines_stay_apart(broken: World) -> None:
    holes = [defect for defect in broken.defects if defect.kind == "pothole"]
    assert len(holes) > 2
    assert len(hosts(broken)) >= len(holes) - 1
    for host in hosts(broken):
        within = [hole for hole in holes if host.polygon.convex_hull.contains(hole.centre)]
        assert len(within) == 1
        assert host.polygon.distance(within[0].polygon) < 2 * APART_M
    outlines = np.array([defect.polygon for defect in broken.defects])
    one, other = shapely.STRtree(outlines).query(outlines, "dwithin", distance=0.999 * APART_M)
    assert (one == other).all()


def test_a_network_with_a_notch_equals_its_heightfield(broken: World) -> None:
    for host in hosts(broken):
        shape = heightfield_of(host)
        outline = rotate(shape.outline, host.yaw_rad, (0, 0), use_radians=True)
        assert translate(outline, host.centre.x, host.centre.y).symmetric_difference(host.polygon).area < 1e-4
        whole = heightfield_of(replace(host, notch=()))
        assert 0.5 * whole.outline.area <= shape.outline.area < 0.98 * whole.outline.area
        assert host.length_m == pytest.approx(measure(shape).crack_length_m, abs=1e-3)
        assert not (shape.height_m[~shape.mask] != 0).any()


def test_notches_are_stored_and_count_as_content(broken: World, tmp_path: Path) -> None:
    some = replace(broken, defects=tuple(replace(each, id=number) for number, each in enumerate(hosts(broken)[:2])))
    save_world(replace(built("cross"), world=some), tmp_path / "town")
    again = load_world(tmp_path / "town")
    assert again.defects == some.defects
    assert again.defects_hash == some.defects_hash
    whole = tuple(replace(each, notch=()) for each in some.defects)
    assert replace(some, defects=whole).defects_hash != some.defects_hash


def test_only_classes_listed_before_can_hold_others(tmp_path: Path) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text(BROKEN.replace("within: {crocodile_crack", "within: {pothole"))
    with pytest.raises(PaveTwinError, match=r"classes\.pothole\.within: 'pothole' is not listed before it"):
        DefectOptions(population=str(file)).effective()

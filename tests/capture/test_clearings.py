"""Where pictures without a defect are taken from."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import shapely

from pavetwin.capture.context import prepare
from pavetwin.capture.image_spec import ROAD_SHARE, footprint
from pavetwin.capture.platforms import CaptureContext
from pavetwin.capture.platforms.car import Car
from pavetwin.capture.platforms.uav import Clearings, Uav
from pavetwin.capture.samples import draw_sample, image_specs, next_attempt, relaxed
from pavetwin.capture.settings import CaptureSettings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import Built
from pavetwin.world.store import save_world
from scenes import built, damaged
from scenes.tiny import straight


@pytest.fixture(scope="module")
def crowded() -> Built:
    return damaged("cross", 24)


@pytest.fixture(scope="module")
def context(crowded: Built, tmp_path_factory: pytest.TempPathFactory) -> CaptureContext:
    world = save_world(crowded, tmp_path_factory.mktemp("clear") / "w")
    return prepare(
        world,
        CaptureSettings(platforms=("uav",), images=100, altitudes_m=(8.0, 19.0), densities=("low",), seed=5, empty=0.5),
    )


def test_points_are_drawn_from_all_of_the_road_that_is_clear_and_from_nothing_else() -> None:
    road = straight((20, 0), (45, 1))
    outlines = [defect.polygon for defect in road.defects]
    clearings = Clearings.of(road.segments, shapely.STRtree(outlines), 4.0)
    rng = np.random.default_rng(1)
    points = np.array([clearings.draw(rng)[0] for _ in range(2000)])
    clear = shapely.difference(road.segments[0].polygon, shapely.union_all(shapely.buffer(outlines, 4.0)))
    assert (shapely.distance(clear, shapely.points(points)) < 0.2).all()
    left, bottom, right, top = clear.bounds
    for box in (shapely.box(x, bottom, x + 5, top) for x in np.arange(left, right, 5.0)):
        share = shapely.intersection(box, clear).area / clear.area
        assert np.mean(shapely.contains_xy(box, points)) == pytest.approx(share, abs=0.04)
    assert Clearings.of(road.segments, shapely.STRtree(outlines), 60.0).draw(rng) is None


@pytest.mark.slow
def test_no_defect_is_shown_wherever_none_is_asked_for(context: CaptureContext) -> None:
    """24 defects a street leave little room for pictures from 19 m, and in some splits none: they are taken lower."""
    platform = Uav(context)
    defects = shapely.STRtree([defect.polygon for defect in context.world.defects])
    empty = [spec for spec in image_specs(context.settings, context.world, "uav", 100) if not spec.aims]
    assert len(empty) > 45
    lower = 0
    for spec in empty:
        attempt, sample = 0, draw_sample(platform, spec, 0)
        while sample is None:
            attempt = next_attempt(spec, attempt, sample)
            sample = draw_sample(platform, relaxed(platform, spec, attempt), attempt)
        assert sample.spec.aims == ()
        assert not len(defects.query(footprint(sample.pose.view), predicate="intersects"))
        lower += sample.spec.altitude_m != spec.altitude_m
    assert 0 < lower < 10


@pytest.mark.slow
@pytest.mark.parametrize(("per_segment", "ahead"), [(24, (0.0, 0.1)), (1, (0.4, 0.9))])
def test_a_car_s_pictures_without_a_defect_show_road(
    crowded: Built, tmp_path: Path, per_segment: int, ahead: tuple[float, float]
) -> None:
    """Where defects lie close, all that is free of them ahead is the meadow beyond a street's end."""
    few = DefectOptions(population="paper", per_segment=per_segment)
    world = save_world(crowded if per_segment == 24 else add_defects(built("cross"), few), tmp_path / "w")
    settings = CaptureSettings(platforms=("car",), images=60, densities=("low",), seed=5, empty=0.5, size_px=(320, 320))
    platform = Car(prepare(world, settings))
    defect_index = platform.context.defect_index
    taken = []
    for spec in image_specs(settings, world, "car", 60):
        sample = None if spec.aims else draw_sample(platform, spec, 0)
        if sample is not None:
            assert defect_index.road_share(sample.pose.view) >= ROAD_SHARE
            assert not defect_index.outlines.query(footprint(sample.pose.view), predicate="intersects").size
            heading = sample.pose.yaw_rad
            further = sample.pose.view.position[:2] + 12 * np.array([np.cos(heading), np.sin(heading)])
            assert sample.pose.mount == "rear" or shapely.contains_xy(defect_index.road, *further)
            taken.append(sample.pose.mount)
    assert len(taken) > 20
    assert ahead[0] <= taken.count("front") / len(taken) <= ahead[1]


def test_a_share_of_the_images_without_defects_shows_a_person_or_a_vehicle(crowded: Built, tmp_path: Path) -> None:
    world = save_world(crowded, tmp_path / "w")
    settings = CaptureSettings(
        platforms=("uav",), images=80, altitudes_m=(8.0,), densities=("medium",), seed=5, empty=0.5
    )
    shares = {}
    for share in (0.0, 0.8):
        platform = Uav(prepare(world, settings.model_copy(update={"road_users": share})))
        kinds: Counter[str] = Counter()
        specs = [spec for spec in image_specs(settings, world, "uav", 80) if not spec.aims]
        for spec in specs:
            sample = draw_sample(platform, spec, 0)
            assert sample is not None
            assert not platform.context.defect_index.outlines.query(footprint(sample.pose.view), "intersects").size
            agents = platform.context.traces["medium"].agents_at(sample.pose.time_s)
            ground = np.column_stack([agents["x_m"], agents["y_m"], np.zeros(len(agents["x_m"]))])
            place = sample.pose.view.project(ground) / settings.size_px
            seen = (np.abs(place - 0.5) < 0.42).all(axis=1)
            pedestrian = platform.context.recordings["medium"].agents.is_pedestrian[agents["agent"][seen]]
            kinds["person"] += bool(pedestrian.any())
            kinds["vehicle"] += bool((~pedestrian).any())
        shares[share] = {kind: number / len(specs) for kind, number in kinds.items()}
    assert shares[0.8]["person"] > shares[0.0]["person"] + 0.2
    assert shares[0.8]["person"] + shares[0.8]["vehicle"] > 0.7

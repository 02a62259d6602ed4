"""Potholes within networks of cracks: the network loses the part where they lie, and each place has one label."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from pavetwin.defects import DefectOptions, heightfield_of, measure, place
from pavetwin.defects.placement import APART_M
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import Defect, World
from pavetwin.world.store import load_world, save_world
from scenes import built

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


def test_a_network_with_a_notch_is_what_its_heightfield_says(broken: World) -> None:
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

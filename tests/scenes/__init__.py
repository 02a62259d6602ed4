"""Small towns of our own making, and real ones from the shared data; each is built once a session."""

import os
from functools import cache
from pathlib import Path

import pytest

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import BuildOptions, Built, build_world
from pavetwin.world.network import network_from_osm, source_kind
from pavetwin.world.roadnet import RoadNet, read_roadnet

HERE = Path(__file__).parent
REAL = Path(os.environ.get("PAVETWIN_SHARED_DATA", HERE.parents[2] / "shared" / "data")) / "osm"


def scene_file(name: str) -> Path:
    """A hand-made map, or a real one (`berlin_neukoelln` …); the test is skipped where that is absent."""
    own = HERE / f"{name}.osm"
    if own.is_file():
        return own
    real = REAL / f"{name}.osm"
    if not real.is_file():
        pytest.skip(f"real input {real} is absent (name its folder in PAVETWIN_SHARED_DATA)")
    return real


@cache
def built(name: str, seed: int = 1, parking_rule: str = "europe") -> Built:
    """The world of a scene, without defects; a name without a file is a kind of network to generate."""
    if name in ("town", "grid", "spider", "random"):
        return build_world(name, BuildOptions(seed=seed, parking_rule=parking_rule))
    return build_world(scene_file(name), BuildOptions(seed=seed, parking_rule=parking_rule))


@cache
def damaged(name: str = "cross", per_segment: int = 8) -> Built:
    """The same with as many defects on every segment as the population `paper` places; each is placed once a session,
    since a defect takes some 10 ms."""
    return add_defects(built(name), DefectOptions(population="paper", per_segment=per_segment))


def net_of(name: str, folder: Path) -> RoadNet:
    """The SUMO network of a scene's map."""
    source = scene_file(name)
    assert source_kind(source) == "osm"
    network_from_osm(source, folder / "roads.net.xml")
    return read_roadnet(folder / "roads.net.xml")

"""What a world keeps of its network: lane numbers, driving side, connections with their turns, signal links."""

import math
from dataclasses import replace
from pathlib import Path

import pyogrio
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.world.build import build_world
from pavetwin.world.model import Direction, Lane, SignalLink, World
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.roads import net_text, parting_lanes
from scenes.traffic import scene_world


def test_lanes_are_numbered_as_the_network_says_whatever_their_ids(tmp_path: Path) -> None:
    world = parting_lanes(tmp_path).world
    assert [(lane.id, lane.index) for lane in world.lanes_on("in")] == [("at-the-kerb", 0), ("towards-the-middle", 1)]
    assert [lane.index for lane in world.lanes if lane.edge == "in"] == [0, 1]
    assert world.lanes_on("rails") == ()


@pytest.mark.parametrize("left_hand", [False, True])
def test_the_middle_of_a_street_is_on_the_side_that_the_network_drives_on(tmp_path: Path, left_hand: bool) -> None:
    world = parting_lanes(tmp_path, left_hand=left_hand).world
    assert world.left_hand is left_hand
    kerb, middle = world.lanes_on("in")
    between = world.beside(kerb, kerb.width_m / 2)
    assert between.distance(middle.centre_line) == pytest.approx(middle.width_m / 2)
    assert world.beside(kerb, -kerb.width_m / 2).distance(middle.centre_line) == pytest.approx(1.5 * middle.width_m)
    street = next(street for street in world.streets if street.name == "Way")
    assert street.centre_line.distance(between) < 0.01


def test_a_street_keeps_its_class_and_junctions(tmp_path: Path) -> None:
    street = next(street for street in parting_lanes(tmp_path).world.streets if street.name == "Way")
    assert (street.id, street.kind, street.edges, street.start, street.end) == (
        "in",
        "highway.primary",
        ("in",),
        "a",
        "m",
    )
    both = next(street for street in built("cross").world.streets if len(street.edges) == 2)
    assert [both.end_of(edge) for edge in both.edges] == [both.end, both.start]


def test_connections_run_along_internal_lanes_and_know_turn_and_signal(tmp_path: Path) -> None:
    ahead, aside = parting_lanes(tmp_path).world.connections
    assert (ahead.from_lane, ahead.to_lane, ahead.direction) == ("at-the-kerb", "x", Direction.STRAIGHT)
    assert (aside.from_lane, aside.to_lane, aside.direction) == ("towards-the-middle", "y", Direction.LEFT)
    assert (ahead.signal, aside.signal) == (SignalLink("lights", 4), SignalLink("lights", 7))
    corners = [(100, 0), (104, 0), (106, 12)]
    assert list(aside.centre_line.coords) == corners, "over both internal lanes"


def _heading(lane: Lane, end: int) -> float:
    (ax, ay), (bx, by) = list(lane.centre_line.coords)[-2:] if end else list(lane.centre_line.coords)[:2]
    return math.atan2(by - ay, bx - ax)


def _turned(world: World, from_lane: str, to_lane: str) -> float:
    lanes = {lane.id: lane for lane in world.lanes}
    angle = _heading(lanes[to_lane], 0) - _heading(lanes[from_lane], -1)
    return math.degrees(math.remainder(angle, math.tau))


def test_a_signalled_cross_has_three_turns_an_arm_each_with_its_own_link(tmp_path: Path) -> None:
    world = scene_world("cross", tmp_path)
    angles = {Direction.LEFT: 90.0, Direction.RIGHT: -90.0, Direction.STRAIGHT: 0.0}
    vehicles = [each for each in world.connections if each.signal and each.direction in angles]
    arms: dict[str, set[Direction]] = {}
    for connection in vehicles:
        arms.setdefault(connection.from_lane, set()).add(connection.direction)
        turned = _turned(world, connection.from_lane, connection.to_lane)
        assert turned == pytest.approx(angles[connection.direction], abs=1.0)
    assert [len(turns) for turns in arms.values()] == [3, 3, 3, 3]
    links = [each.signal.link for each in world.connections if each.signal]
    links += [crossing.signal.link for crossing in world.crossings if crossing.signal]
    assert len(world.crossings) == 4
    assert sorted(links) == list(range(len(links))), "every letter of the state belongs to one way across"


@pytest.mark.parametrize("left_hand", [False, True])
def test_all_of_it_comes_back_from_the_geopackage(tmp_path: Path, left_hand: bool) -> None:
    saved = save_world(parting_lanes(tmp_path, left_hand=left_hand), tmp_path / "world")
    loaded = load_world(tmp_path / "world")
    assert loaded == saved
    assert loaded.left_hand is left_hand
    assert len(loaded.connections) == 2
    assert loaded.lanes_on("in")[1].id == "towards-the-middle"
    layers = dict(pyogrio.list_layers(tmp_path / "world" / "world.gpkg"))
    assert layers["streets"] == layers["connections"] == "LineString"


def test_an_edited_connection_makes_another_world(tmp_path: Path) -> None:
    made = parting_lanes(tmp_path)
    ahead, aside = made.world.connections
    edited = replace(made.world, connections=(ahead, replace(aside, direction=Direction.RIGHT)))
    save_world(replace(made, world=edited), tmp_path / "edited")
    assert load_world(tmp_path / "edited").content_hash != made.world.content_hash


def test_layers_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    made = parting_lanes(tmp_path)
    world = made.world
    one, other = world.lanes_on("in")
    rest = tuple(lane for lane in world.lanes if lane.edge != "in")
    lost = replace(world.connections[0], to_lane="nowhere")
    cases = {
        "lost": (replace(world, connections=(lost,)), "from 'at-the-kerb' to 'nowhere' names the lane 'nowhere'"),
        "twice": (replace(world, lanes=(one, replace(other, index=0), *rest)), "of the edge 'in' have one index, 0"),
        "same": (replace(world, lanes=(*world.lanes, one)), "two lanes have the id 'at-the-kerb'"),
        "homeless": (replace(world, streets=()), "'s0001' lies on the edges"),
    }
    for name, (conflicting, words) in cases.items():
        save_world(replace(made, world=conflicting), tmp_path / name)
        with pytest.raises(PaveTwinError, match=r"contradicts itself.*build it again") as caught:
            load_world(tmp_path / name)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('to="ahead" fromLane="0" toLane="0" via', 'to="ahead" fromLane="0" toLane="3" via', "to lane 3 of the edge"),
        ('<connection from="in"', '<connection from="of"', "from lane 0 of the edge 'of'"),
        ('via="inside c"', 'via="inside d"', "runs over 'inside d'"),
        (
            'id="at-the-kerb" index="0"',
            'id="at-the-kerb" index="1"',
            "of the edge 'in' have one index, 1",
        ),
    ],
)
def test_a_network_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = net_text()
    assert old in text
    path = tmp_path / "broken.net.xml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(PaveTwinError, match=r"broken\.net\.xml' is not a complete SUMO network") as caught:
        build_world(path)
    assert words in str(caught.value)

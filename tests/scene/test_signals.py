"""Signal heads: every approach shows the letter of its own links, as the recording has it."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.scene.scene import Scene
from pavetwin.scene.signals import DARK, GLOW, VEHICLES, WALKERS, Head, heads_of, instances, lamps, letter, walker_poles
from pavetwin.scene.values import Instance
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.world.furniture import signals_of
from pavetwin.world.model import Furniture, FurnitureKind, World
from pavetwin.world.roadnet import read_roadnet
from scenes import built
from scenes.traffic import scene_world

RED, AMBER, GREEN = 0, 1, 2


@pytest.fixture(scope="module")
def crossroads(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A signalled cross with a mast at each approach."""
    world = scene_world("cross", tmp_path_factory.mktemp("signals"))
    net = read_roadnet(world.network_file)
    masts = [candidates[0] for candidates in signals_of(net, 0.12)]
    return replace(world, furniture=tuple(replace(mast, id=f"signal{k}") for k, mast in enumerate(masts)))


@pytest.fixture(scope="module")
def traffic(crossroads: World) -> Recording:
    return record(crossroads, "low", 1, 120.0)


def lit(instance: Instance) -> set[int]:
    return {slot for slot in range(3) if instance.tints[slot, 3] > 0}


def test_every_approach_has_two_heads_and_every_crossing_two(crossroads: World) -> None:
    heads = heads_of(crossroads, crossroads.carriageway)
    assert sum(head.model == VEHICLES for head in heads) == 8
    assert sum(head.model == WALKERS for head in heads) == 2 * len(crossroads.crossings)
    assert len({(head.controller, head.link) for head in heads if head.model == VEHICLES}) == 4


def test_heads_look_at_the_traffic_that_they_stop(crossroads: World) -> None:
    for head in heads_of(crossroads, crossroads.carriageway):
        if head.model == VEHICLES:
            outward = np.array([head.x_m, head.y_m])  # the junction is at the origin
            assert head.transform[:2, 0] @ outward / np.hypot(*outward) > 0.8


def test_heads_show_their_links_letter_at_every_step(crossroads: World, traffic: Recording) -> None:
    """Against the network: the head of the edge from the west shows what the links from that edge have."""
    rows = ElementTree.parse(crossroads.network_file).getroot().iter("connection")
    edge_of = {int(row.attrib["linkIndex"]): row.attrib["from"] for row in rows if "tl" in row.attrib}
    side = {"wc": (-1, 0), "ec": (1, 0), "sc": (0, -1), "nc": (0, 1)}
    (states,) = traffic.signals.values()
    seen = set()
    for head in heads_of(crossroads, crossroads.carriageway):
        if head.model != VEHICLES:
            continue
        assert head.link is not None
        where = np.array([head.x_m, head.y_m])
        assert np.array(side[edge_of[head.link]]) @ where > 4.0
        for step, state in states:
            for time_s in (step * traffic.step_s, (step + 0.5) * traffic.step_s):
                shown = letter(head, traffic, time_s)
                assert shown == state[head.link]
                seen.add(shown)
                (drawn,) = instances([head], traffic, time_s)
                expected = {"r": {RED}, "y": {AMBER}, "G": {GREEN}, "g": {GREEN}}[shown]
                assert lit(drawn) == expected
    assert {"r", "y"} < seen


def test_the_state_holds_until_the_next_change(crossroads: World, traffic: Recording) -> None:
    (states,) = traffic.signals.values()
    (first, state), (change, _) = states[0], states[1]
    head = next(head for head in heads_of(crossroads, crossroads.carriageway) if head.link is not None)
    assert head.link is not None
    for step in (first, change - 1):
        assert letter(head, traffic, step * traffic.step_s) == state[head.link]


def test_walkers_heads_face_each_other_across_their_crossing(crossroads: World) -> None:
    heads = [head for head in heads_of(crossroads, crossroads.carriageway) if head.model == WALKERS]
    for one, other in zip(heads[::2], heads[1::2], strict=True):
        assert one.link == other.link
        assert one.transform[:2, 0] @ other.transform[:2, 0] == pytest.approx(-1.0, abs=1e-6)
        between = np.array([other.x_m - one.x_m, other.y_m - one.y_m])
        assert one.transform[:2, 0] @ between > 4.0


@pytest.mark.parametrize("town", ["berlin_neukoelln", "seattle_roosevelt"])
def test_walkers_poles_stand_next_to_the_carriageway(town: str) -> None:
    world = built(town).world
    road = world.carriageway
    signalled = [crossing for crossing in world.crossings if crossing.signalled]
    poles = [at for crossing in signalled for at, _ in walker_poles(crossing, road)]
    assert len(poles) > 1.7 * len(signalled) > 6
    assert shapely.distance(shapely.points(poles), road).min() > 0.4


def test_unlit_lamps_are_dark_and_lit_ones_glow(crossroads: World, traffic: Recording) -> None:
    head = heads_of(crossroads, crossroads.carriageway)[0]
    tints = lamps(head, traffic, 0.0)
    on = tints[:3, 3] > 0
    assert on.sum() == 1
    assert (tints[:3][on] == (1, 1, 1, GLOW)).all()
    assert (tints[:3, :3][~on] == np.float32(DARK)).all()


def test_without_traffic_signals_are_off(crossroads: World) -> None:
    assert all(not lit(drawn) for drawn in instances(heads_of(crossroads, crossroads.carriageway), None, 0.0))


def test_blinking_amber_blinks() -> None:
    head = Head(VEHICLES, np.eye(4), "c", 0)

    class Blinking:
        signals = {"c": ((0, "o"),)}  # noqa: RUF012
        step_s = 0.5

    times = (0.1, 0.7, 1.2, 1.9)
    shown = [lamps(head, Blinking(), time_s)[1, 3] > 0 for time_s in times]  # type: ignore[arg-type]
    assert shown == [True, False, True, False]


def test_a_world_without_connections_has_heads_that_show_nothing(crossroads: World, traffic: Recording) -> None:
    mast = Furniture("s", FurnitureKind.SIGNAL, Point(5, -5), 6.0, 0.12, np.pi / 2, 4.0, controller="c")
    heads = heads_of(replace(crossroads, connections=(), furniture=(mast,), crossings=()), crossroads.carriageway)
    assert len(heads) == 2
    assert all(not lit(drawn) for drawn in instances(heads, traffic, 3.0))


def test_the_scene_gives_signals_with_its_agents(crossroads: World, traffic: Recording) -> None:
    scene = Scene(crossroads, seed=0)
    everything = scene.agents(traffic, 30.0)
    assert sum(each.model in (VEHICLES, WALKERS) for each in everything) == len(
        heads_of(crossroads, crossroads.carriageway)
    )
    assert sum(each.label > 0 for each in everything) > 0
    near = scene.agents(traffic, 30.0, near=(-9.0, -4.0, 6.0))
    assert (
        0 < sum(each.model in (VEHICLES, WALKERS) for each in near) < len(heads_of(crossroads, crossroads.carriageway))
    )

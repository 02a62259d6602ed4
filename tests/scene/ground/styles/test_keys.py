"""Every key of a style and of a marking standard has an effect: with one changed, what lies on the ground differs."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
import shapely
from pydantic import BaseModel

from pavetwin.scene.ground import GroundPlan, ground_maps, plan_ground
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import StreetStyle, street_style
from pavetwin.scene.ground.styles.marking_standard import MarkingStandard, marking_standard
from pavetwin.world.model import LaneKind, World
from scenes import built, tiny

ELSEWHERE = {"title", "overhead", "bridge_joints", "areas"}
"""Words, and keys with tests of their own: `test_wires`, `test_bridge_joints`, `test_standards`."""

SOME_OF_ALL: dict[str, object] = {
    "dirt": {},
    "repairs.cold_patches_per_100_m": 20.0,
    "stretches.share": 1.0,
    "former_markings.share": 1.0,
    "former_markings.kinds": {"worn": 1},
    "covers": {"cover_iron": 1},
    "sidewalks.pavings": {"blocks": 1},
}

ALONG_A_STREET = {
    "other": {"concrete": 1},
    "stretches.share": 0.0,
    "stretches.pavements": {"chip_seal": 1},
    "repairs.patches": {"repair_concrete": 1},
    "repairs.trenches": {"repair_concrete": 1},
    "repairs.connections": 1.0,
    "repairs.renewed": 1.0,
    "repairs.cold_patches": {"repair_concrete": 1},
    "repairs.cold_patches_per_100_m": 0.0,
    "dirt.water": 0.0,
    "dirt.plants": 0.0,
    "dirt.sand": 0.0,
}

IN_A_TOWN = {
    "main": {"concrete": 1},
    "former_markings.share": 0.0,
    "former_markings.kinds": {"overpainted": 1},
    "former_markings.wear": {"least": 0.1, "most": 0.2},
    "former_markings.moved_m": {"least": 1.0, "most": 1.2},
    "dirt.tyre_marks": 0.0,
    "dirt.oil": 0.0,
    "dirt.leaves": 0.0,
    "paint_wear": 0.0,
    "covers": {"cover_square": 1},
    "grates": {"grate_slots": 1},
    "litter_per_100_m": 50.0,
    "sidewalks.pavings": {"setts": 1},
    "sidewalks.red": 1.0,
    "sidewalks.tone": {"least": 0.5, "most": 0.6},
    "marks": {"survey_cross": 5.0},
    "markings": "united_states",
}

OF_FORMER_KINDS = {
    "former_markings.beside_m": ("overpainted", {"least": 0.2, "most": 0.3}),
    "former_markings.removed_tone": ("removed", {"least": 0.4, "most": 0.5}),
    "former_markings.masked_tone": ("masked", {"least": 1.4, "most": 1.5}),
}

LINES: dict[str, object] = {
    "centre_colour": "white",
    "solid_centre_share": 0.0,
    "double_solid": True,
    "edge_share": 1.0,
    "left_edge_colour": "white",
    "kerb_colour": "white",
    "kerb_share": 1.0,
    "signalled": {"ladder": 1},
    "unsignalled": {"ladder": 1},
    "hatching": {"corner_share": 1.0, "junction_share": 1.0},
    "box": {"every_m": 2.0, "share": 1.0},
    "rumble": {"kind": "painted", "bar_m": [0.2, 0.3], "bars": 3, "groups": 2, "main_share": 1.0, "other_share": 1.0},
}
"""Some of everything, beside what the standard of Germany has."""

OF_A_STANDARD: dict[str, object] = {
    "line_m": 0.3,
    "centre_m": 0.3,
    "broad_m": 0.4,
    "lane_dash_m": [1.0, 1.0],
    "centre_dash_m": [1.0, 1.0],
    "centre_colour": "yellow",
    "solid_centre_share": 1.0,
    "double_solid": False,
    "double_gap_m": 0.3,
    "edge_share": 0.0,
    "edge_colour": "yellow",
    "left_edge_colour": None,
    "kerb_colour": "red",
    "kerb_share": 0.0,
    "stop_m": 0.2,
    "give_way": "triangles",
    "give_way_dash_m": [1.0, 1.0],
    "give_way_m": 0.2,
    "stripe_m": [0.3, 0.3],
    "crossing_colour": "yellow",
    "signalled": {"none": 1},
    "unsignalled": {"none": 1},
    "crossing_line_m": 0.3,
    "crossing_dash_m": None,
    "hatching.colour": "yellow",
    "hatching.border_m": 0.3,
    "hatching.stripe_m": [1.0, 0.5],
    "hatching.angle_deg": 60.0,
    "hatching.corner_share": 0.0,
    "hatching.junction_share": 0.0,
    "box.colour": "white",
    "box.line_m": 0.3,
    "box.every_m": 1.0,
    "box.share": 0.0,
    "rumble.kind": "milled",
    "rumble.colour": "red",
    "rumble.bar_m": [0.3, 0.3],
    "rumble.bars": 5,
    "rumble.groups": 1,
    "rumble.groups_every_m": 5.0,
    "rumble.before_m": 5.0,
    "rumble.main_share": 0.0,
    "rumble.other_share": 0.0,
}

SOLID = {"double_solid", "double_gap_m"}
"""Of solid centre lines only."""

ONE_WAY = {"broad_m", "left_edge_colour"}
"""Of one-way streets and beside bicycle lanes, which the cross has none of."""


def changed(values: Mapping[str, Any], key: str, value: object) -> dict[str, Any]:
    """Values of settings with one of them replaced, by its dotted name."""
    head, _, rest = key.partition(".")
    return {**values, head: changed(values[head], rest, value) if rest else value}


def keys(of: type[BaseModel]) -> set[str]:
    """The dotted names of the keys of settings and of those within them."""
    found = set()
    for name, field in of.model_fields.items():
        parts = [field.annotation, *get_args(field.annotation)]
        inner = [each for each in parts if isinstance(each, type) and issubclass(each, BaseModel)]
        if inner and name not in ELSEWHERE and set(inner[0].model_fields) != {"least", "most"}:
            found |= {f"{name}.{each}" for each in keys(inner[0])}
        else:
            found.add(name)
    return found - ELSEWHERE


def style(*changes: tuple[str, object]) -> StreetStyle:
    """Grey asphalt with some of everything."""
    values = street_style("uniform").model_dump(mode="json")
    for key, value in (*SOME_OF_ALL.items(), *changes):
        values = changed(values, key, value)
    return StreetStyle.model_validate(values)


def drawn(world: World, of: StreetStyle) -> str:
    """All that lies on the ground of a world, in words."""
    plan = plan_ground(world, 3, style=of)
    surfaces = [asdict(plan.surface_of(street)) for street in plan.streets]
    surfaces += [{str(kind): finish} for kind, finish in plan.walk_surfaces]
    return told([asdict(plan.repairs), asdict(plan.paint), [asdict(each) for each in plan.fixtures], surfaces])


def told(values: object) -> str:
    return json.dumps(
        values, default=lambda each: each.tolist() if isinstance(each, np.ndarray) else shapely.to_wkt(each)
    )


@cache
def street() -> World:
    return tiny.straight(length_m=900.0)


@cache
def as_before(town: bool, kind: str = "worn") -> str:
    return drawn(built("cross").world if town else street(), style(("former_markings.kinds", {kind: 1})))


def test_every_key_of_a_look_is_tried() -> None:
    assert keys(StreetStyle) == {*ALONG_A_STREET, *IN_A_TOWN, *OF_FORMER_KINDS}


@pytest.mark.parametrize("key", sorted(ALONG_A_STREET.keys() - {"dirt.sand"}))
def test_a_key_of_a_look_changes_a_street(key: str) -> None:
    assert drawn(street(), style((key, ALONG_A_STREET[key]))) != as_before(town=False)
    assert drawn(street(), style()) == as_before(town=False)


@pytest.mark.parametrize("key", sorted(IN_A_TOWN))
def test_a_key_of_a_look_changes_a_town(key: str) -> None:
    assert drawn(built("cross").world, style((key, IN_A_TOWN[key]))) != as_before(town=True)


@pytest.mark.parametrize("key", sorted(OF_FORMER_KINDS))
def test_a_key_of_earlier_markings_changes_those_of_its_kind(key: str) -> None:
    kind, value = OF_FORMER_KINDS[key]
    assert drawn(built("cross").world, style(("former_markings.kinds", {kind: 1}), (key, value))) != as_before(
        True, kind
    )


def test_sand_changes_the_maps() -> None:
    plans = (plan_ground(street(), 3, style=of) for of in (style(), style(("dirt.sand", 0.0))))
    sandy, clean = (ground_maps(plan, (0, -1)).weathering for plan in plans)
    assert (sandy != clean).any()


@cache
def cross(*, one_way: bool = False) -> GroundPlan:
    """The cross; or with its streets one-way, and bicycle lanes where vehicles park."""
    world = built("cross").world
    if one_way:
        streets = tuple(replace(each, edges=each.edges[:1]) for each in world.streets)
        parking, bicycle = LaneKind.PARKING, LaneKind.BICYCLE
        lanes = tuple(replace(each, kind=bicycle) if each.kind is parking else each for each in world.lanes)
        world = replace(world, streets=streets, lanes=lanes, parking=())
    return plan_ground(world, 3, style=style(("former_markings.share", 0.0)))


@cache
def painted(*changes: tuple[str, str], one_way: bool = False) -> str:
    """The markings of the cross; changes are keys with values in JSON."""
    values = marking_standard("germany").model_dump(mode="json") | LINES
    for key, value in changes:
        values = changed(values, key, json.loads(value))
    return told(asdict(markings(cross(one_way=one_way), MarkingStandard.model_validate(values))))


def test_every_key_of_a_marking_standard_is_tried() -> None:
    assert keys(MarkingStandard) == set(OF_A_STANDARD)


@pytest.mark.parametrize("key", sorted(OF_A_STANDARD))
def test_a_key_of_a_marking_standard_changes_the_paint(key: str) -> None:
    before = (("solid_centre_share", "1"),) if key in SOLID else ()
    change = (key, json.dumps(OF_A_STANDARD[key]))
    one_way = key in ONE_WAY
    assert painted(*before, change, one_way=one_way) != painted(*before, one_way=one_way)

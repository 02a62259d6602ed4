"""What stands still hides defects: the kernel's prisms, the same prisms drawn, and the models of trees and lamps.

Drawn as prisms, masks and kernel are two ways to the same number. Crowns have gaps and arms are slimmer than their
prisms, so the models may show more, and never less.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, cached_property

import numpy as np
import pytest
from shapely import Point
from shapely.affinity import translate

from pavetwin.defects import DefectOptions, place
from pavetwin.render.renderer import Renderer
from pavetwin.scene.appearance import tints
from pavetwin.scene.furniture import stand
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import Instance, Mesh, Model, defect_label
from pavetwin.scene.view import nadir
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Defect, Furniture, FurnitureKind, World
from pavetwin.world.solids import furniture_prisms
from scenes import tiny
from scenes.captures import captures, is_whole
from scenes.stage import SeenLight, light_of

LIGHT = Light(45.0, 140.0)
ALTITUDE_M = 15.0
LENGTH_M = 90.0
LEAST_PX = 150
"""Shares of smaller masks say little: the pixels along their edges are most of them."""
LAMPS_FROM_M = 45.0
"""Trees stand along the first half of the street, lamps along the second."""


def tree(number: int) -> Furniture:
    """In the road itself: from above, crowns at its kerbs hide what lies behind them, next to the road."""
    place = Point(5.0 + 7.0 * number, (3.4, -3.2)[number % 2])
    height, crown = 6.5 + number % 3, 2.2 + 0.3 * (number % 4)
    return Furniture(f"t{number}", FurnitureKind.TREE, place, height, crown, clear_height_m=2.5 + 0.4 * (number % 3))


def lamp(number: int) -> Furniture:
    """As in a side street, its arm over the road."""
    place, yaw = Point(46.0 + 2.2 * number, (5.0, -5.0)[number % 2]), (-np.pi / 2, np.pi / 2)[number % 2]
    arm = 3.5 + 0.5 * (number % 3)
    return Furniture(f"l{number}", FurnitureKind.STREET_LIGHT, place, 6.0 + number % 3, 0.08, yaw_rad=yaw, arm_m=arm)


@cache
def street() -> World:
    segment = tiny.street("street", (0, 0), (LENGTH_M, 0), width_m=9.0)
    potholes = [
        each
        for each in place([segment], 3, DefectOptions(population="paper", per_segment=30))
        if each.kind == "pothole"
    ]
    defects = [moved(potholes[number % len(potholes)], number) for number in range(30)]
    return tiny.world([segment], defects, furniture=[*map(tree, range(6)), *map(lamp, range(16))])


def moved(defect: Defect, number: int) -> Defect:
    """The same at another place of the street, by turns on either side, nearer to and farther from its middle."""
    x, y = 4.0 + 2.8 * number, (-3.3, 2.4, 3.4, -2.2)[number % 4]
    shape = translate(defect.polygon, x - defect.centre.x, y - defect.centre.y)
    return replace(defect, id=number, centre=Point(x, y), polygon=shape)


@cache
def prisms() -> Mapping[str, Model]:
    found = [prism for thing in street().furniture for _, prism in furniture_prisms(thing)]
    return {f"prism{number}": Model(f"prism{number}", {"body": drawn(*prism)}) for number, prism in enumerate(found)}


class Bare(Scene):
    """Without its furniture, whose prisms are among its models."""

    def __init__(self) -> None:
        super().__init__(replace(street(), furniture=()), seed=1)

    @cached_property
    def models(self) -> Mapping[str, Model]:
        return {**super().models, **prisms()}


def drawn(ring: np.ndarray, low_m: float, high_m: float) -> Mesh:
    """A prism over a convex anticlockwise base (n, 2)."""
    count = len(ring)
    ends = [np.column_stack([ring, np.full(count, height)]) for height in (low_m, high_m)]
    k = np.arange(count)
    after = (k + 1) % count
    sides = np.concatenate([np.stack([k, after, after + count], 1), np.stack([k, after + count, k + count], 1)])
    fan = np.stack([np.zeros(count - 2), k[1:-1], k[2:]], 1)
    indices = np.concatenate([sides, fan[:, ::-1], fan + count]).astype(np.uint32)
    positions = np.concatenate(ends).astype(np.float32)
    up = np.tile(np.array([0, 0, 1], dtype=np.float32), (2 * count, 1))
    return Mesh(positions, up, indices)


@cache
def shares() -> np.ndarray:
    """(n, 4) of defects that are whole in an image: east, visible share by kernel, by masks of prisms, of models."""
    scene = Bare()
    renderer = Renderer(scene)
    as_prisms = [Instance(name, "body", np.eye(4), tints()) for name in prisms()]
    as_models = [
        each for number, thing in enumerate(street().furniture) for each in stand(thing, number, 0.0, 1, scene.models)
    ]
    found = []
    for event, _ in captures(tiny.Scene(street(), altitude_m=ALTITUDE_M), north_m=1.0):
        place = (*event.position, event.altitude_m)
        view = nadir(find_camera("paper"), place, yaw_rad=event.yaw_rad, size_px=(635, 475))
        seen = [light_of(renderer, view, instances=each, light=LIGHT, amodal=True) for each in (as_prisms, as_models)]
        for number, by_kernel in event.sightings:
            defect = street().defects[number]
            if is_whole(view, defect) and seen[0].amodal_px[defect_label(number)] >= LEAST_PX:
                masks = (visible(each, defect_label(number)) for each in seen)
                found.append((defect.centre.x, by_kernel, *masks))
    return np.array(found)


def visible(seen: SeenLight, label: int) -> float:
    assert seen.labels is not None
    return float((seen.labels == label).sum()) / seen.amodal_px[label]


@pytest.mark.slow
@pytest.mark.parametrize("things", ["trees", "lamps"])
def test_prisms_hide_of_a_defect_what_the_kernel_states(things: str) -> None:
    by_kernel, by_prisms, _ = below(things)
    assert (by_kernel < 0.98).sum() >= 3
    assert np.abs(by_kernel - by_prisms).max() <= 0.05


@pytest.mark.parametrize("things", ["trees", "lamps"])
def test_models_hide_no_more_and_stand_in_the_same_place(things: str) -> None:
    by_kernel, _, by_models = below(things)
    assert (by_models - by_kernel).min() >= -0.05
    below_it = by_kernel < 0.98
    assert by_models[below_it].mean() < 0.95
    assert by_models[~below_it].min() >= 0.95


def below(things: str) -> np.ndarray:
    """(3, n) of the defects along one half of the street: shares by kernel, by masks of prisms, of models."""
    found = shares()
    return found[(found[:, 0] < LAMPS_FROM_M) == (things == "trees"), 1:].T

"""Shares of a defect that the kernel counts as hidden, compared with what the instance image shows of it."""

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import shapely

from pavetwin.defects import DefectOptions, place
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import defect_label
from pavetwin.scene.view import nadir
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import World
from scenes import tiny
from scenes.captures import captures, is_whole, outline_px
from scenes.solids import as_solids, solids
from scenes.stage import light_of

LIGHT = Light(45.0, 140.0)
CAMERA = find_camera("paper")
LENGTH_M = 90.0
SIZES = {"paper": (1270, 950), "square": (640, 640)}


@cache
def street() -> World:
    """A wide street full of defects, bare otherwise."""
    segment = tiny.street("street", (0, 0), (LENGTH_M, 0), width_m=9.0)
    return tiny.world([segment], place([segment], 3, DefectOptions(population="paper", per_segment=80)))


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    scene = Scene(street(), seed=1)
    scene.__dict__["models"] = {**scene.models, **solids()}
    return Renderer(scene)


# Shares.


class Share(NamedTuple):
    by_kernel: float
    by_masks: float


def random_movers(altitude_m: float, rng: np.random.Generator) -> list[tiny.Mover]:
    """Cars, people and, from high enough, trucks: standing askew and passing."""
    sizes = (tiny.CAR, tiny.TRUCK, tiny.PERSON) if altitude_m > 7 else (tiny.CAR, tiny.PERSON)
    standing = [
        tiny.parked(rng.uniform(3, LENGTH_M - 3), rng.uniform(-4, 4), sizes[k % len(sizes)], yaw_rad=rng.uniform(-1, 1))
        for k in range(16)
    ]
    speeds = rng.uniform(-9, 9, 6)
    return standing + [tiny.passing(rng.uniform(0, LENGTH_M), rng.uniform(-4, 4), float(speed)) for speed in speeds]


def shares(renderer: Renderer, altitude_m: float, seed: int) -> Iterator[Share]:
    rng = np.random.default_rng(seed)
    scene = tiny.Scene(street(), tuple(random_movers(altitude_m, rng)), altitude_m=altitude_m)
    for event, trace in captures(scene, north_m=float(rng.uniform(-2, 2))):
        view = nadir(CAMERA, (*event.position, event.altitude_m), yaw_rad=event.yaw_rad)
        agents = as_solids(trace.agents_at(event.time_s))
        seen = light_of(renderer, view, instances=agents, light=LIGHT, amodal=True)
        assert seen.labels is not None
        for number, share in event.sightings:
            if is_whole(view, street().defects[number]):
                label = defect_label(number)
                yield Share(share, float((seen.labels == label).sum()) / seen.amodal_px[label])


@pytest.mark.slow
def test_the_kernels_share_is_that_of_the_masks(renderer: Renderer) -> None:
    found = [share for seed, height in enumerate((6.0, 10.0, 15.0)) for share in shares(renderer, height, seed)]
    by_kernel, by_masks = np.array(found).T
    partly = (by_masks > 0.02) & (by_masks < 0.98)
    apart = np.abs(by_kernel - by_masks)
    print(f"{len(found)} defects, {partly.sum()} partly hidden: {apart[partly].mean():.4f}, at most {apart.max():.4f}")
    assert partly.sum() >= 40
    assert (by_masks < 0.02).sum() >= 5
    assert apart.max() <= 0.05
    assert apart[partly].mean() <= 0.015


# Outlines.


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("altitude_m", [6.0, 10.0, 15.0])
def test_an_outline_and_its_mask_are_one(renderer: Renderer, size: str, altitude_m: float) -> None:
    """Also of cracks 5 mm wide, whose labelled strip is less than two pixels wide from 15 m."""
    taken: dict[str, int] = {}
    for defect in street().defects:
        offset = np.array([0.31, -0.17]) * (1 + defect.id % 3)
        place = (defect.centre.x + offset[0], defect.centre.y + offset[1], altitude_m)
        view = nadir(CAMERA, place, yaw_rad=0.7 * defect.id, size_px=SIZES[size])
        if taken.get(defect.kind, 0) >= 3 or not is_whole(view, defect):
            continue
        taken[defect.kind] = taken.get(defect.kind, 0) + 1
        seen = light_of(renderer, view, light=LIGHT)
        assert seen.labels is not None
        columns, rows = np.meshgrid(np.arange(view.size_px[0]) + 0.5, np.arange(view.size_px[1]) + 0.5)
        outline = shapely.Polygon(outline_px(view, defect))
        shapely.prepare(outline)
        inside, mask = shapely.contains_xy(outline, columns, rows), seen.labels == defect_label(defect.id)
        assert (inside & mask).sum() / (inside | mask).sum() >= 0.95
    assert set(taken.values()) == {3}
    assert len(taken) == 3

"""Parked vehicles hide defects from masks as they do from the kernel, drawn as its boxes; models are slimmer."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pavetwin.defects import DefectOptions, place
from pavetwin.mission.environment import FIRST_ID, parked_columns
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import defect_label, labelled_place, parked_label
from pavetwin.scene.view import View, look, nadir
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import World
from scenes import tiny
from scenes.captures import captures, is_whole
from scenes.parking import FULL, kerb_place, with_places
from scenes.solids import as_solids, solids
from scenes.stage import SeenLight, light_of

LIGHT = Light(45.0, 140.0)
CAMERA = find_camera("paper")
LENGTH_M = 60.0


@cache
def street() -> World:
    """Cars at both kerbs from end to end, and so many defects that some lie under every one."""
    segment = tiny.street("street", (0, 0), (LENGTH_M, 0), width_m=9.0)
    world = tiny.world([segment], place([segment], 3, DefectOptions(population="paper", per_segment=60)))
    places = [
        kerb_place(3.0 + 6.0 * k, y, name=f"{k}{side}") for k in range(10) for side, y in (("l", 3.4), ("r", -3.4))
    ]
    return with_places(world, *places)


@cache
def parked() -> ParkedVehicles:
    scene = tiny.Scene(street())
    return scene.environment(scene.settings(FULL)).parked


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    scene = Scene(street(), seed=1)
    scene.__dict__["models"] = {**scene.models, **solids()}
    return Renderer(scene)


def share(seen: SeenLight, number: int) -> float:
    """Visible pixels of a defect by its amodal ones."""
    label = defect_label(number)
    assert seen.labels is not None
    return float((seen.labels == label).sum()) / max(seen.amodal_px[label], 1)


def shares(renderer: Renderer, altitude_m: float) -> list[tuple[float, float, float]]:
    """Visible shares of defects: by the kernel, by the masks of boxes, by the masks of models."""
    scene = tiny.Scene(street(), altitude_m=altitude_m)
    boxes = as_solids(parked_columns(parked()), lambda number: parked_label(number - FIRST_ID))
    models = renderer.scene.parked(parked())
    found = []
    for event, _ in captures(scene, 1.0, FULL):
        view = nadir(CAMERA, (*event.position, event.altitude_m), yaw_rad=event.yaw_rad, size_px=(800, 600))
        as_boxes, as_models = (
            light_of(renderer, view, instances=drawn, light=LIGHT, amodal=True) for drawn in (boxes, models)
        )
        for number, by_kernel in event.sightings:
            if is_whole(view, street().defects[number]):
                found.append((by_kernel, share(as_boxes, number), share(as_models, number)))
    return found


@pytest.mark.slow
def test_the_kernels_share_is_that_of_the_masks(renderer: Renderer) -> None:
    by_kernel, by_boxes, by_models = np.array(shares(renderer, 6.0)).T
    partly = (by_boxes > 0.02) & (by_boxes < 0.98)
    apart = np.abs(by_kernel - by_boxes)
    more = (by_models - by_boxes)[partly]
    print(f"{partly.sum()} of {len(apart)} partly hidden: {apart[partly].mean():.4f}, at most {apart.max():.4f}")
    print(
        f"models show {np.median(more):.3f} more in the median, {more.mean():.3f} on average, at most {more.max():.3f}"
    )
    assert partly.sum() >= 6
    assert (by_boxes < 0.02).sum() >= 3
    assert apart.max() <= 0.05
    assert apart[partly].mean() <= 0.015
    assert more.min() > -0.05, "models hide no more than their boxes"
    assert more.mean() < 0.25


@pytest.mark.slow
def test_parked_cars_look_the_same_without_their_back_faces(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also from a car, through the gaps between tyres and wheel arches."""
    whole = Renderer(renderer.scene)
    monkeypatch.setattr(whole._gpu_scene.parts, "single_sided", frozenset())
    view = look((6.0, 0.0, 1.2), yaw_rad=0.3, pitch_rad=-0.15, size_px=(500, 360), vertical_fov_rad=0.9)
    drawn = renderer.scene.parked(parked())
    front, both = (light_of(one, view, instances=drawn, light=LIGHT, amodal=True) for one in (renderer, whole))
    assert front.labels is not None
    assert both.labels is not None
    cars = np.isin(both.labels, [one.label for one in drawn])
    assert cars.mean() > 0.1
    differ = (front.labels != both.labels).sum() / cars.sum()
    print(f"{differ:.5f} of the cars' pixels differ")
    assert differ < 0.004
    for label, pixels in front.amodal_px.items():
        assert pixels >= (front.labels == label).sum()


def seen_from_above(renderer: Renderer, stands: ParkedVehicles, x: float, y: float) -> SeenLight:
    view: View = nadir(CAMERA, (x, y, 6.0), yaw_rad=0.0, size_px=(400, 300))
    return light_of(renderer, view, instances=renderer.scene.parked(stands), light=LIGHT, amodal=True)


def test_under_a_car_nothing_is_left_of_a_defect(renderer: Renderer) -> None:
    """And it is the car that is seen there, whole, with the label of its place."""
    under = [
        (row, defect)
        for row in range(len(parked()))
        for defect in street().defects
        if defect.polygon.within(parked_body(row))
    ]
    assert len(under) >= 3
    for row, defect in under[:3]:
        free = seen_from_above(renderer, ParkedVehicles.empty(), defect.centre.x, defect.centre.y)
        hidden = seen_from_above(renderer, parked(), defect.centre.x, defect.centre.y)
        assert share(free, defect.id) == 1.0
        assert share(hidden, defect.id) == 0.0
        assert hidden.labels is not None
        middle = int(hidden.labels[150, 200])
        assert labelled_place(middle) == parked().place[row]
        assert hidden.amodal_px[middle] > 5000


def parked_body(row: int):
    """Well within the outline, below which no camera looks."""
    stands = parked()
    place = replace(
        street().parking[stands.place[row]],
        length_m=stands.length_m[row] - 1.0,
        width_m=stands.width_m[row] - 0.5,
    )
    return place.polygon


def test_a_parked_car_darkens_the_road_next_to_it(renderer: Renderer) -> None:
    """Its shadow lies to the north-west of it, under a sun in the south-east."""
    alone = parked().only(parked().place == 1)
    x, y = float(alone.x[0]), float(alone.y[0])
    with_it, without = (seen_from_above(renderer, stands, x, y + 1.6) for stands in (alone, ParkedVehicles.empty()))
    assert with_it.labels is not None
    road = with_it.labels == 0
    darker = with_it.radiance[..., 1].astype(float) / np.maximum(without.radiance[..., 1], 1e-3)
    assert (darker[road] < 0.6).mean() > 0.05
    assert np.median(darker[road]) == pytest.approx(1.0, abs=0.02)

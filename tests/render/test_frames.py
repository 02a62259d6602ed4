"""Labels, depths and places in frames, against a ray caster that shares no code with the renderer but the view."""

import os
from dataclasses import replace
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

from pavetwin.render.frame import Exposure, RenderedFrame
from pavetwin.scene.light import Light
from pavetwin.scene.view import View, look
from pavetwin.uav.cameras import find_camera
from scenes.stage import Box, cast, plane_renderer

LIGHT = Light(40.0, 150.0)
CAMERA = find_camera("paper")
SIZE = (320, 240)

VIEWS = {
    "nadir, north up": look((3, 4, 12), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=SIZE, vertical_fov_rad=1.0),
    "nadir, turned": look((-2, 5, 9), yaw_rad=-2.3, pitch_rad=-pi / 2, size_px=SIZE, vertical_fov_rad=1.2),
    "tilted": look((0, -9, 10), yaw_rad=1.4, pitch_rad=radians(-55), size_px=SIZE, vertical_fov_rad=1.0),
    "along the street": look((-12, 1, 1.4), yaw_rad=0.1, pitch_rad=radians(-12), size_px=SIZE, vertical_fov_rad=0.9),
    "level": look((10, 14, 2.0), yaw_rad=-1.9, pitch_rad=0.0, size_px=SIZE, vertical_fov_rad=0.8),
    "crop of a nadir frame": look(
        (-2, 5, 9), yaw_rad=-2.3, pitch_rad=-pi / 2, size_px=(560, 400), vertical_fov_rad=1.6
    ).crop((235, 5), SIZE),
    "crop of a tilted frame": look(
        (0, -9, 10), yaw_rad=1.4, pitch_rad=radians(-55), size_px=(480, 360), vertical_fov_rad=1.4
    ).crop((15, 90), SIZE),
    "far from the origin": look((371.5, -360.25, 15), yaw_rad=0.4, pitch_rad=-1.3, size_px=SIZE, vertical_fov_rad=1.0),
}


def frame(view: View, boxes: list[Box], **options: object) -> RenderedFrame:
    instances = tuple(box.instance for box in boxes)
    return plane_renderer().frame(view, light=LIGHT, camera=CAMERA, instances=instances, **options)


def scattered(view: View, count: int, seed: int, small: bool = False) -> list[Box]:
    """Boxes about what a view looks at, a third of them without a label, none around the camera."""
    rng = np.random.default_rng(seed)
    middle = view.position[:2] + 9 * view.rays(np.array(view.size_px) / 2)[:2]
    found: list[Box] = []
    reach = 5 if small else 9
    while len(found) < count:
        x, y = (middle + rng.uniform(-reach, reach, 2)).tolist()
        sizes = np.full(3, 0.12) if small else rng.uniform((0.3, 0.3, 0.4), (4.0, 2.0, 3.0))
        if np.hypot(x - view.position[0], y - view.position[1]) < np.hypot(*sizes[:2]) + (
            0 if view.position[2] > 4 else 1
        ):
            continue
        label = 0 if not small and len(found) % 3 == 2 else 1 + len(found)
        z = float(rng.uniform(0, 1.0)) * (rng.random() < 0.3)
        found.append(Box(x, y, *sizes.tolist(), yaw_rad=float(rng.uniform(-pi, pi)), z=z, label=label))
    return found


@pytest.mark.parametrize("name", VIEWS)
def test_a_small_thing_lands_where_the_view_projects_it(name: str) -> None:
    view, boxes = VIEWS[name], scattered(VIEWS[name], 24, seed=3, small=True)
    seen = frame(view, boxes)
    assert seen.labels is not None
    found = 0
    for box in boxes:
        rows, columns = np.nonzero(seen.labels == box.label)
        corners = view.project(box.corners)
        inside = np.isfinite(corners).all() and (corners > 1).all() and (corners < np.array(SIZE) - 1).all()
        whole = len(rows) == seen.amodal_px.get(box.label)
        if inside and whole and len(rows) > 3:
            found += 1
            assert np.hypot(*(np.array([columns.mean(), rows.mean()]) + 0.5 - view.project(box.middle))) < 1.0
    assert found >= 5


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("seed", [0, 1])
def test_labels_depths_and_amodal_pixels_are_those_of_rays(name: str, seed: int) -> None:
    view, boxes = VIEWS[name], scattered(VIEWS[name], 24, seed=seed)
    seen, expected = frame(view, boxes), cast(VIEWS[name], boxes)
    assert seen.labels is not None
    assert seen.depth_m is not None
    # A ray within rounding of an edge may fall to either side of it.
    off = seen.labels != expected.labels
    assert off.mean() < 0.0005
    assert set(np.unique(seen.labels[~off])) == set(np.unique(expected.labels[~off]))
    assert len(np.unique(seen.labels)) >= 8
    near = (expected.depth_m < 100) & ~off
    error = np.abs(seen.depth_m[near] - expected.depth_m[near]) / expected.depth_m[near]
    assert (error < 1e-4).mean() > 0.9995
    for label, count in expected.amodal.items():
        assert seen.amodal_px.get(label, 0) == pytest.approx(count, rel=0.002, abs=3)
        assert seen.amodal_px.get(label, 0) >= (seen.labels == label).sum()


def test_without_occlusion_visible_and_amodal_pixels_agree() -> None:
    view = VIEWS["nadir, turned"]
    boxes = [Box(-2 + 2.4 * k, 4 + 0.7 * k, 1.6, 0.8, 0.5, yaw_rad=k, label=7 + k) for k in range(-1, 2)]
    seen = frame(view, boxes)
    for box in boxes:
        assert (seen.labels == box.label).sum() == seen.amodal_px[box.label] > 200


def test_the_ground_is_as_deep_as_its_plane() -> None:
    for view in VIEWS.values():
        seen = frame(view, [])
        expected = cast(view, []).depth_m
        assert seen.depth_m is not None
        near = expected < 120
        assert near.mean() > 0.3
        assert np.allclose(seen.depth_m[near], expected[near], rtol=2e-5)
        assert np.isinf(seen.depth_m[np.isinf(expected)]).all()
        assert (seen.labels == 0).all()


def test_what_is_behind_the_camera_or_outside_the_image_is_not_reported() -> None:
    view = VIEWS["along the street"]
    behind, beside = Box(-20, 1, 2, 2, 2, label=1), Box(0, 40, 2, 2, 2, label=2)
    ahead = Box(0, 1, 2, 2, 2, label=3)
    seen = frame(view, [behind, beside, ahead])
    assert set(np.unique(seen.labels)) == {0, 3}
    assert {label for label, count in seen.amodal_px.items() if count} == {3}


def test_a_frame_holds_only_what_is_requested() -> None:
    view, boxes = VIEWS["tilted"], scattered(VIEWS["tilted"], 6, seed=5)
    asked = frame(view, boxes)
    bare = frame(view, boxes, labels=False, depth=False)
    assert bare.labels is None
    assert bare.depth_m is None
    assert bare.amodal_px == {}
    assert bare.defect_free is None
    assert np.array_equal(bare.rgb, asked.rgb)
    assert np.array_equal(frame(view, boxes, defect_free=True).defect_free, asked.rgb)


def test_the_same_view_gives_the_same_bytes_in_any_order_and_in_any_size_between() -> None:
    samples = [(VIEWS[name], scattered(VIEWS[name], 8, seed=9)) for name in ("tilted", "nadir, turned", "level")]
    first = [frame(view, boxes, seed=4) for view, boxes in samples]
    wide = look((3, 4, 12), yaw_rad=0.0, pitch_rad=-1.2, size_px=(500, 200), vertical_fov_rad=1.0)
    frame(wide, [])
    again = [frame(view, boxes, seed=4) for view, boxes in reversed(samples)][::-1]
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.rgb, other.rgb)
        assert np.array_equal(one.labels, other.labels)
        assert one.amodal_px == other.amodal_px


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident memory is read as Linux tells it")
def test_frames_leave_no_memory_behind() -> None:
    """Of a driver that compiled a shader for each and kept it there was 0.4 MB a frame."""

    def resident_mib() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

    view = VIEWS["nadir, north up"]
    boxes = scattered(view, 12, seed=5)
    for _ in range(30):
        frame(view, boxes)
    before = resident_mib()
    for _ in range(120):
        frame(view, boxes)
    assert resident_mib() - before < 10


@pytest.mark.parametrize(("name", "row"), [("nadir, turned", 6), ("level", 64)])
def test_a_crop_is_the_part_of_the_whole_frame_that_it_is(name: str, row: int) -> None:
    """Also of the sky, of what moves under a rolling shutter, and where the lens darkens."""
    whole, boxes = VIEWS[name], scattered(VIEWS[name], 24, seed=1)
    column, width, height = 200, 104, 88
    rolling = CAMERA.model_copy(update={"readout_s": 0.05})
    options = {"camera": rolling, "exposure": Exposure(1 / 500, 2.8, 100.0), "light": LIGHT}
    options["instances"] = tuple(box.instance for box in boxes)

    def moving(view: View) -> View:
        return replace(view, velocity_mps=np.array([4.0, 1.0, 0.0]))

    # The crop's middle row is exposed earlier than the whole frame's, when the camera is farther back.
    earlier_s = rolling.readout_s * (row + height / 2 - whole.size_px[1] / 2) / whole.size_px[1]
    crop = moving(whole).crop((column, row), (width, height))
    crop = replace(crop, position=crop.position + earlier_s * crop.velocity_mps)
    big, small = (plane_renderer().frame(each, **options) for each in (moving(whole), crop))
    part = np.s_[row : row + height, column : column + width]
    assert (big.labels[part] != small.labels).mean() < 0.003
    assert len(np.unique(small.labels)) >= 2
    away = np.abs(big.rgb[part].astype(int) - small.rgb).mean(axis=2)
    assert np.median(away) < 4  # noise differs, and the white balance a little
    assert abs(big.rgb[part].mean() - small.rgb.mean()) < 2

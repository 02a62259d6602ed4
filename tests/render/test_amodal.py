"""The cell of an amodal object holds all of it that is in the image, and little else."""

import numpy as np
import pytest

from pavetwin.render.amodal import AmodalObject, _atlas_cell
from pavetwin.render.projection import NEAR_M, corners
from pavetwin.scene.view import View, look

VIEW: View = look((0.0, 0.0, 1.3), yaw_rad=0.0, pitch_rad=-0.12, size_px=(640, 480), vertical_fov_rad=0.9)


def box(x: float, y: float) -> np.ndarray:
    """Corners of a car's box around a place on the ground."""
    return corners(np.array([x - 2.2, y - 0.9, 0.0]), np.array([x + 2.2, y + 0.9, 1.5]))


def cell_of(body: np.ndarray, margin_px: float = 2.0):
    return _atlas_cell(AmodalObject(1, None, np.zeros(1), body), VIEW, margin_px)


def pixels_of(body: np.ndarray, moved_m: float = 0.0) -> np.ndarray:
    """Where points all over a box appear in the image, moved by up to some metres."""
    rng = np.random.default_rng(1)
    points = rng.uniform(body.min(axis=0), body.max(axis=0), (200_000, 3)) + rng.uniform(-moved_m, moved_m, 3)
    seen = VIEW.project(points[VIEW.to_camera(points)[:, 2] >= NEAR_M])
    return seen[((seen >= 0) & (seen < VIEW.size_px)).all(axis=1)]


@pytest.mark.parametrize(("x", "y"), [(1.5, -2.5), (1.5, 2.5), (2.0, -1.2), (8.0, 1.0)])
def test_a_cell_holds_all_of_a_body_next_to_the_camera(x: float, y: float) -> None:
    cell, seen = cell_of(box(x, y)), pixels_of(box(x, y))
    assert cell is not None
    assert len(seen) > 1000
    assert (seen >= (cell.x, cell.y)).all()
    assert (seen <= (cell.x + cell.width, cell.y + cell.height)).all()


def test_a_car_that_reaches_behind_the_camera_takes_a_part_of_the_atlas() -> None:
    body = box(1.5, -2.5)
    assert VIEW.to_camera(body)[:, 2].min() < 0
    cell = cell_of(body)
    assert cell is not None
    assert cell.width * cell.height < 0.5 * 640 * 480


def test_what_is_behind_the_camera_has_no_cell() -> None:
    assert cell_of(box(-4.0, 0.0)) is None


def test_a_cell_holds_a_body_that_the_rolling_shutter_moves() -> None:
    body, moved_m = box(1.5, -2.5), 0.3
    cell = cell_of(body, 2.0 + moved_m * VIEW.focal_px)
    assert cell is not None
    seen = pixels_of(body, moved_m)
    assert (seen >= (cell.x, cell.y)).all()
    assert (seen <= (cell.x + cell.width, cell.y + cell.height)).all()

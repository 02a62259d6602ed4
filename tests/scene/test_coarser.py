"""Coarser meshes: solid ones stay closed, within their cells."""

from functools import cache

import numpy as np
import shapely

from pavetwin.scene.coarser import closed
from pavetwin.scene.models import BODY, library
from pavetwin.scene.values import Mesh
from pavetwin.scene.web.packing import MODEL_TRIANGLES
from pavetwin.scene.web.shared_files import _within

SIDES = ((0, 0, 1), (0, 1, 0))
"""From above, and from the left."""


@cache
def body(name: str) -> Mesh:
    return library()[name].parts[BODY]


def shown_m2(mesh: Mesh, side: tuple[int, int, int]) -> float:
    """What the triangles that face a side cover of it, seen from there."""
    corners = mesh.positions[mesh.indices].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ side > 0.3 * np.linalg.norm(normals, axis=1)
    flat = corners[facing][:, :, [axis for axis in range(3) if not side[axis]]]
    return float(shapely.union_all(shapely.buffer(shapely.polygons(flat), 0)).area)


def test_vehicles_of_coarse_levels_have_no_holes() -> None:
    whole = body("hatchback_parked")
    for most, least in zip(MODEL_TRIANGLES[1:], (0.9, 0.8), strict=True):
        made = _within(whole, most)
        assert 0.3 * most < len(made.indices) <= most
        for side in SIDES:
            assert shown_m2(made, side) > least * shown_m2(whole, side), (most, side)


def test_vertices_stay_in_their_cells_and_keep_their_slots() -> None:
    whole, cell_m = body("hatchback_parked"), 0.1
    made = closed(whole, cell_m)
    assert made.surface is not None
    assert whole.surface is not None
    assert set(made.surface[:, 2]) == set(whole.surface[:, 2])
    known = {tuple(row) for row in whole.positions.tolist()}
    assert all(tuple(row) in known for row in made.positions.tolist()), "places are some of the vertices'"
    cells = np.unique(np.floor(made.positions / cell_m), axis=0)
    assert len(np.unique(made.positions, axis=0)) == len(cells), "one place for each cell"
    triangles = np.sort(made.positions[made.indices].round(6), axis=1).reshape(-1, 9)
    assert len(np.unique(triangles, axis=0)) >= 0.98 * len(triangles)


def test_a_mesh_within_its_cells_is_as_it_was() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
    up = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    square = Mesh(corners, up, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32))
    made = closed(square, 0.5)
    assert np.array_equal(made.positions[made.indices], square.positions[square.indices])
    assert len(closed(square, 4.0).indices) == 0

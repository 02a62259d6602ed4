"""The committed models: real sizes, known materials, valid meshes, within their budgets. Needs no Blender."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from assets.models.materials import MATERIALS
from numpy.typing import NDArray

import pavetwin.scene
from pavetwin.scene.glb import Glb, from_file_axes, read_glb
from pavetwin.traffic.kinds import KINDS, VEHICLES

FOLDER = Path(pavetwin.scene.__file__).parent / "models"
ALL = sorted(path.stem for path in FOLDER.glob("*.glb"))
ROAD = [kind.name for kind in VEHICLES]
TRIANGLES = {"bus": 12_000, "heavy_truck": 12_000, "quadrotor": 9_000}
"""Most triangles of a model where it is not 9,000."""


def primitives(glb: Glb) -> Iterator[tuple[str, dict[str, NDArray[np.float64]], NDArray[np.int64]]]:
    """Material, attributes and triangles (m, 3) of each primitive."""
    materials = [material["name"] for material in glb.document["materials"]]
    for mesh in glb.document["meshes"]:
        for one in mesh["primitives"]:
            attributes = {name: glb.array(index) for name, index in one["attributes"].items()}
            yield materials[one["material"]], attributes, glb.array(one["indices"]).reshape(-1, 3)


def places(glb: Glb, *materials: str) -> NDArray[np.float64]:
    """Vertices (n, 3) in our axes, of some materials or of all."""
    found = [from_file_axes(a["POSITION"]) for name, a, _ in primitives(glb) if not materials or name in materials]
    return np.concatenate(found).astype(np.float64)


def test_every_kind_of_vehicle_and_the_uav_have_a_model() -> None:
    assert {*ROAD, "quadrotor"} <= set(ALL)


@pytest.mark.parametrize("name", ROAD)
def test_vehicle_stands_on_its_wheels_and_looks_ahead(name: str) -> None:
    glb = read_glb(FOLDER / f"{name}.glb")
    assert places(glb)[:, 2].min() == pytest.approx(0.0, abs=0.005)
    assert places(glb, "tyre")[:, 2].min() == pytest.approx(0.0, abs=0.005)
    assert places(glb, "lamp_front")[:, 0].min() > 0.2 * KINDS[name].length_m
    assert places(glb, "lamp_rear")[:, 0].max() < -0.2 * KINDS[name].length_m


def test_uav_is_as_big_as_a_phantom_4() -> None:
    glb = read_glb(FOLDER / "quadrotor.glb")
    points = places(glb)
    body = points[points[:, 2] < 0.175]  # below the propellers
    assert np.ptp(body[:, 0]) == pytest.approx(0.29, abs=0.01)
    assert np.ptp(body[:, 1]) == pytest.approx(0.29, abs=0.01)
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.002)
    assert points[:, 2].max() == pytest.approx(0.196, abs=0.005)
    assert places(glb, "glass")[:, 2].max() < 0.05  # the lens looks down


@pytest.mark.parametrize("name", ALL)
def test_model_is_a_sound_mesh_of_known_materials(name: str) -> None:
    for material, attributes, corners in primitives(read_glb(FOLDER / f"{name}.glb")):
        assert material in MATERIALS
        assert set(attributes) >= {"POSITION", "NORMAL", "COLOR_0"}
        assert ("TEXCOORD_0" in attributes) == (name.startswith("tree_") and material == "leaf")
        assert corners.max() < len(attributes["POSITION"]) <= 65_535
        assert np.linalg.norm(attributes["NORMAL"], axis=1) == pytest.approx(1.0, abs=1e-3)
        assert attributes["COLOR_0"].min() >= 0.0
        assert attributes["COLOR_0"].max() <= 1.0


@pytest.mark.parametrize("name", [*ROAD, "quadrotor"])
def test_triangles_are_within_the_budget(name: str) -> None:
    triangles = sum(len(corners) for _, _, corners in primitives(read_glb(FOLDER / f"{name}.glb")))
    assert triangles <= TRIANGLES.get(name, 9_000)


@pytest.mark.parametrize("name", [*ROAD, "quadrotor"])
def test_faces_look_the_way_their_normals_do(name: str) -> None:
    for material, attributes, corners in primitives(read_glb(FOLDER / f"{name}.glb")):
        points, normals = attributes["POSITION"].astype(float)[corners], attributes["NORMAL"].astype(float)[corners]
        faces = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        agree = (faces * normals.sum(axis=1)).sum(axis=1) > 0.0
        area = np.linalg.norm(faces, axis=1)
        assert area[agree].sum() > 0.99 * area.sum(), material


@pytest.mark.parametrize("name", ROAD)
def test_the_top_is_open_and_what_looks_down_is_dark(name: str) -> None:
    top, below = [], []
    for _, attributes, _ in primitives(read_glb(FOLDER / f"{name}.glb")):
        z, up = attributes["POSITION"][:, 1], attributes["NORMAL"][:, 1]
        shade = attributes["COLOR_0"][:, :3].max(axis=1)
        top.append(shade[(up > 0.9) & (z > 0.8 * KINDS[name].height_m)])
        below.append(shade[up < -0.3])
    assert np.percentile(np.concatenate(top), 75) > 0.85
    assert np.concatenate(below).mean() < 0.75


@pytest.mark.parametrize("name", [kind.name for kind in VEHICLES if kind.sumo_class == "passenger"])
def test_no_black_lines_are_seen_from_above(name: str) -> None:
    """Thinner than a pixel they would be drawn as dashes: gaps between panels are darker paint."""
    for material, attributes, _ in primitives(read_glb(FOLDER / f"{name}.glb")):
        if material == "gap":
            z, up = attributes["POSITION"][:, 1], attributes["NORMAL"][:, 1]
            assert not ((up > 0.5) & (z > 0.55 * KINDS[name].height_m)).any()


def test_models_are_small_together() -> None:
    sizes = {path.stem: path.stat().st_size for path in FOLDER.glob("*.glb")}
    assert sum(sizes.values()) <= 10 * 2**20
    assert sum(sizes[name] for name in [*ROAD, "quadrotor"]) <= 5 * 2**20

"""Tiles for browsers: what goes in comes back within the steps of its numbers, and levels agree with each other."""

import gzip
import json
import random
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from shapely import Point
from typer.testing import CliRunner

from pavetwin.cli.world import app
from pavetwin.defects import DefectOptions, place
from pavetwin.errors import PaveTwinError
from pavetwin.scene.export import tiles_of
from pavetwin.scene.glb import Glb, from_file_axes
from pavetwin.scene.light import Light, harmonics
from pavetwin.scene.meshes import merged
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, Mesh
from pavetwin.scene.web import WEB_LEVELS, WebLevel, WebTown
from pavetwin.scene.web.packing import FINEST_STEP_M, step_of, steps_of
from pavetwin.scene.web.shared_files import light_values
from pavetwin.scene.web.tiles import TileFiles
from pavetwin.scene.web.town import tile_name
from pavetwin.world.model import Furniture, FurnitureKind, World
from scenes import built, tiny

Triangles = npt.NDArray[np.float64]
SPACING_M = 0.2
"""Of the points by which surfaces are compared."""


@cache
def world() -> World:
    street = tiny.street("street", (0.0, 0.0), (64.0, 0.0))
    return replace(
        tiny.world(
            [street],
            place([street], 2, DefectOptions(population="paper", per_segment=9)),
            buildings=[
                tiny.block("flat", 10.0, 10.0, 24.0, 20.0, 9.0),
                tiny.block("house", 40.0, 9.0, 50.0, 17.0, 7.5),
            ],
            furniture=[
                Furniture("tree", FurnitureKind.TREE, Point(31, 8), 9.3, 2.7, clear_height_m=3.1),
                Furniture("light", FurnitureKind.STREET_LIGHT, Point(33, -4.1), 8.0, 0.1, np.pi / 2, 1.5),
            ],
        ),
        content_hash="0" * 64,
    )


@cache
def town() -> WebTown:
    return WebTown(Scene(world(), seed=1), folder=Path("/nowhere"))


@cache
def files() -> TileFiles:
    return TileFiles(town().scene)


@cache
def read(level: int, column: int, row: int) -> Glb:
    return Glb(gzip.decompress(files().tile(WEB_LEVELS[level], (column, row))))


def mesh_of(glb: Glb, name: str) -> Triangles | None:
    """(n, 3, 3) corners of a node's triangles in the world frame."""
    for node in glb.document["nodes"]:
        if node["name"] == name:
            (primitive,) = glb.document["meshes"][node["mesh"]]["primitives"]
            steps = glb.array(primitive["attributes"]["POSITION"]).astype(np.float64)
            points = steps * node["scale"] + node["translation"]
            return np.asarray(points[:, [2, 0, 1]][glb.array(primitive["indices"]).reshape(-1, 3)])
    return None


def surfaces(level: int, column: int, row: int) -> Triangles:
    """All triangles of ground and houses of one tile of 32 m of a level; of the coarsest those of its square."""
    side = WEB_LEVELS[level].side
    glb = read(level, column // side, row // side)
    parts = [mesh_of(glb, name) for name in ("ground", "fills", "houses", "town")]
    return np.concatenate([part for part in parts if part is not None])


def placed(mesh: Mesh, column: int, row: int) -> Triangles:
    return np.asarray((mesh.positions.astype(np.float64) + (column * TILE_M, row * TILE_M, 0.0))[mesh.indices])


def points_on(triangles: Triangles) -> npt.NDArray[np.float64]:
    """Points on triangles, about one each SPACING_M², and all corners."""
    rng = np.random.default_rng(1)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    each = np.repeat(np.arange(len(area)), rng.poisson(4 * area / SPACING_M**2))
    u, v = rng.random(len(each)), rng.random(len(each))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (triangles[each, corner] for corner in range(3))
    return np.concatenate([a + u[:, None] * (b - a) + v[:, None] * (c - a), triangles.reshape(-1, 3)])


@pytest.mark.slow
def test_the_finest_level_comes_back() -> None:
    key = (1, 0)
    tile, glb = town().scene.tile(key), read(0, *key)
    for name, pieces in (("ground", tile.ground), ("houses", tile.facades)):
        expected, found = placed(merged([piece.mesh for piece in pieces]), *key), mesh_of(glb, name)
        assert found is not None
        assert found.shape == expected.shape
        (step,) = {node["scale"][0] for node in glb.document["nodes"] if node["name"] == name}
        assert np.abs(found - expected).max() <= step / 2 + 1e-6
        assert step <= 2 * FINEST_STEP_M


def test_normals_and_colours_come_back() -> None:
    tile, glb = town().scene.tile((1, 0)), read(0, 1, 0)
    houses = merged([piece.mesh for piece in tile.facades])
    (node,) = [node for node in glb.document["nodes"] if node["name"] == "houses"]
    (primitive,) = glb.document["meshes"][node["mesh"]]["primitives"]
    attributes = {name: glb.array(index) for name, index in primitive["attributes"].items()}
    assert np.abs(from_file_axes(attributes["NORMAL"]) - houses.normals).max() < 0.005
    assert houses.colours is not None
    assert np.abs(attributes["COLOR_0"][:, :3] - np.clip(houses.colours, 0, 1)).max() <= 0.5 / 255 + 1e-6
    layers = np.repeat([piece.layer + 1 for piece in tile.facades], [len(p.mesh.positions) for p in tile.facades])
    assert (attributes["_LAYER"] == layers).all()


@pytest.mark.slow
@pytest.mark.parametrize("level", [1, 2])
def test_coarse_levels_are_as_near_to_the_finest_as_they_state(level: int) -> None:
    keys = [(column, row) for column in (0, 1) for row in (0, 1)]
    fine = np.concatenate([surfaces(0, *key) for key in keys])
    coarse = surfaces(level, 0, 0) if level == 2 else np.concatenate([surfaces(level, *key) for key in keys])
    assert len(coarse) < 0.75 * len(fine)
    one, other = points_on(fine), points_on(coarse)
    error = WEB_LEVELS[level].error_m
    for here, there in ((one, other), (other, one)):
        # A point of the other surface is near one of its samples.
        away = cKDTree(there).query(here)[0]
        assert away.max() < error + SPACING_M
        assert np.quantile(away, 0.9) < SPACING_M


@pytest.mark.parametrize("level", WEB_LEVELS, ids=lambda level: str(level.number))
def test_no_gap_opens_between_neighbours(level: WebLevel) -> None:
    """The ground of two tiles has the same height along their border, and each covers its square."""
    border, side = level.side_m, level.side_m
    profiles = []
    for column in (0, 1):
        glb = read(level.number, column, 0)
        parts = [mesh_of(glb, name) for name in ("ground", "fills", "town")]
        ground = np.concatenate([part for part in parts if part is not None])
        flat = ground[..., :2]
        inside = (flat.min(axis=1) >= (column * side - 1e-9, -1e-9)).all(axis=1) & (ground[..., 2].max(axis=1) < 0.5)
        inside &= (flat.max(axis=1) <= ((column + 1) * side + 1e-9, side + 1e-9)).all(axis=1)
        low = ground[inside]
        (ax, ay), (bx, by) = (low[:, 1] - low[:, 0])[:, :2].T, (low[:, 2] - low[:, 0])[:, :2].T
        assert np.abs(ax * by - ay * bx).sum() / 2 == pytest.approx(side**2, rel=2e-4)
        corners = low.reshape(-1, 3)
        rim = np.unique(corners[corners[:, 0] == border], axis=0)
        assert len(rim) >= 2
        profiles.append(rim[np.argsort(rim[:, 1])])
    ways = np.unique(np.concatenate([rim[:, 1] for rim in profiles]))
    one, other = (np.interp(ways, rim[:, 1], rim[:, 2]) for rim in profiles)
    assert np.abs(one - other).max() <= 2 * FINEST_STEP_M


def test_the_relief_of_defects_fills_the_holes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.scene.web.tiles.DEFECTS_A_PART", 2)
    scene = town().scene
    keys = [key for key in town().squares[0] if files().parts(key)]
    assert max(files().parts(key) for key in keys) >= 2, "several parts are to be tested"
    area, named = 0.0, set()
    for tile, part in [(key, part) for key in keys for part in range(files().parts(key))]:
        glb = Glb(gzip.decompress(files().relief(tile, part)))
        triangles = mesh_of(glb, "defects")
        if triangles is not None:
            corners = triangles[..., :2]
            (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
            area += float(np.abs(ax * by - ay * bx).sum()) / 2
            assert triangles[..., 2].max() < 0.05
        named |= set(glb.document["asset"]["extras"]["defects"])
    assert named == {defect.id for defect in scene.world.defects}
    assert area == pytest.approx(sum(scene.hole(number).area for number in range(len(named))), rel=0.02)
    outlines = read(0, *keys[0]).document["asset"]["extras"]["defects"]
    assert {each["id"] for each in outlines} == {scene.world.defects[n].id for n in scene.holes_on(keys[0])}


def test_objects_stand_where_they_stand_and_coarse_levels_keep_the_large_ones() -> None:
    near, middle, far = (read(level, 1 if level < 2 else 0, 0).document["asset"]["extras"] for level in range(3))
    lamp = next(item for item in world().furniture if item.id == "light")
    assert any(
        np.allclose((row[11], row[9]), (lamp.position.x, lamp.position.y), atol=1e-3)
        for row in read(0, 1, -1).document["asset"]["extras"]["instances"]["shaft:tapered"]
    )
    assert set(middle["instances"]) <= set(near["instances"])
    assert any(name.endswith(":crown") for name in far["instances"])
    assert not any(name.startswith("shaft:") for name in far["instances"])
    assert len(json.dumps(far["instances"])) < len(json.dumps(near["instances"])) + 2000


def test_the_order_in_which_files_are_made_does_not_matter(tmp_path: Path) -> None:
    again = WebTown(Scene(world(), seed=1), folder=tmp_path / "again")
    names = [tile_name(level, key) for level, keys in zip(WEB_LEVELS, again.squares, strict=True) for key in keys[:2]]
    names += [name for name in again.names() if name.startswith("defects/")][:2]
    random.Random(3).shuffle(names)
    for name in names:
        assert again.file(name) == town()._maker(name)(), name


def test_a_file_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = WebTown(Scene(world(), seed=1), folder=tmp_path)
    name = tile_name(WEB_LEVELS[1], first.squares[1][0])
    made = first.file(name)
    later = WebTown(Scene(world(), seed=1), folder=tmp_path)
    monkeypatch.setattr(TileFiles, "tile", lambda *_: pytest.fail("it was there"))
    assert later.file(name) == made
    assert later.manifest()["levels"][1]["tiles"][0][-1] == len(made)
    assert later.manifest()["levels"][1]["tiles"][1][-1] is None


def test_what_files_depend_on_names_their_folder() -> None:
    base = WebTown(Scene(world(), seed=1))
    others = [
        WebTown(Scene(world(), seed=2)),
        WebTown(Scene(world(), seed=1, style="uniform")),
        WebTown(Scene(replace(world(), defects=world().defects[1:]), seed=1)),
        WebTown(Scene(replace(world(), content_hash="1" * 64), seed=1)),
    ]
    digests = {each.digest for each in (base, *others)}
    assert len(digests) == 5
    assert WebTown(Scene(world(), seed=1)).digest == base.digest


@pytest.mark.parametrize(
    "name",
    [
        "",
        "manifest.json",
        "../models.glb.gz",
        "0/../0_0.glb.gz",
        "0/9999_0.glb.gz",
        "3/0_0.glb.gz",
        "defects/0_0_99.glb.gz",
    ],
)
def test_no_other_file_is_given(name: str) -> None:
    with pytest.raises(KeyError):
        town().file(name)


def test_levels_cover_the_same_land() -> None:
    fine, middle, coarse = town().squares
    side = WEB_LEVELS[2].side
    assert fine == middle
    assert {(column // side, row // side) for column, row in fine} == set(coarse)
    assert len(fine) == side**2 * len(coarse)
    assert set(tiles_of(town().scene)) <= set(fine)


def test_bounds_hold_what_a_tile_shows() -> None:
    entries = {tuple(entry[:2]): entry[2:] for entry in town().manifest()["levels"][0]["tiles"]}
    for key in ((0, 0), (1, 0)):
        west, south, east, north, top, _ = entries[key]
        points = surfaces(0, *key).reshape(-1, 3)
        assert (points.min(axis=0)[:2] >= (west - 0.01, south - 0.01)).all()
        assert (points.max(axis=0) <= (east + 0.01, north + 0.01, top)).all()


def test_the_light_is_that_of_frames() -> None:
    light = Light(35.0, 140.0, cloud_cover=0.2)
    values = light_values(light)
    normal = np.array([0.3, -0.5, 0.81])
    normal /= np.linalg.norm(normal)
    bands = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    there = (harmonics(normal[[1, 2, 0]]) * bands) @ np.array(values["irradiance"])
    assert there == pytest.approx(harmonics(normal) @ light.sky_irradiance, rel=1e-3)
    assert np.array(values["to_sun"])[[2, 0, 1]] == pytest.approx(light.to_sun, abs=1e-4)


@given(st.floats(0.01, 2000.0), st.floats(-1.0, 1.0))
def test_steps_hold_positions_to_half_a_step(reach_m: float, share: float) -> None:
    step = step_of(reach_m)
    value = np.array([[reach_m * share, reach_m, -reach_m]])
    assert np.abs(steps_of(value, step) * step - value).max() <= step / 2 + 1e-12
    assert step == FINEST_STEP_M or reach_m / step > 32_767 / 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--detail", "low"], "--detail applies to exports to one file"),
        (["--at", "3"], "--at applies to exports to one file"),
        (["--dry-run"], "--dry-run applies to exports to one file"),
        (["--bounds", "9000,9000,9100,9100"], "no streets within these bounds"),
        (["--time", "00:30"], "below the horizon"),
    ],
)
def test_the_command_refuses_what_makes_no_sense(tmp_path: Path, arguments: list[str], words: str) -> None:
    from pavetwin.world.store import save_world

    save_world(built("grid"), tmp_path / "grid")
    result = CliRunner().invoke(app, ["export", str(tmp_path / "grid"), str(tmp_path / "web"), "--web", *arguments])
    assert isinstance(result.exception, PaveTwinError)
    assert words in str(result.exception)
    assert not (tmp_path / "web").exists()


@pytest.mark.slow
def test_the_command_writes_a_folder(tmp_path: Path) -> None:
    from pavetwin.world.store import save_world

    save_world(cross := built("cross"), tmp_path / "cross")
    at = cross.world.segments[0].centre_line.interpolate(0.5, normalized=True)
    bounds = f"--bounds={at.x - 2},{at.y - 2},{at.x + 2},{at.y + 2}"
    words = ["export", str(tmp_path / "cross"), str(tmp_path / "web"), "--web", "--jobs", "1", bounds]
    result = CliRunner().invoke(app, [*words, "--time", "17:00", "--clouds", "0.5"])
    assert result.exception is None, result.output
    folder = tmp_path / "web"
    manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    assert manifest["light"]["to_sun"][2] < 0, "in the afternoon the sun is in the west"
    listed = {
        f"{level['level']}/{entry[0]}_{entry[1]}.glb.gz": entry[-1]
        for level in manifest["levels"]
        for entry in level["tiles"]
    }
    assert f"Written to {folder}: {len(listed)} tiles in" in " ".join(result.output.split())
    listed |= {manifest[name]["file"]: manifest[name]["bytes"] for name in ("models", "facades", "leaves")}
    parts = {f"defects/{key}_{part}.glb.gz" for key, n in manifest["defects"]["parts"].items() for part in range(n)}
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert written == {*listed, *parts, "manifest.json"}
    assert all((folder / name).stat().st_size == size for name, size in listed.items())
    with_models = Glb(gzip.decompress((folder / "models.glb.gz").read_bytes()))
    names = {node["name"] for node in with_models.document["nodes"]}
    assert {"saloon:body:2", "tree_round:crown:0", "pedestrian_man_jacket:walk_0:1"} <= names
    refused = CliRunner().invoke(app, words)
    assert isinstance(refused.exception, PaveTwinError)
    assert "exists" in str(refused.exception)
    assert CliRunner().invoke(app, [*words, "--force"]).exception is None

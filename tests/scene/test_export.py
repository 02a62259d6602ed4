"""The glTF file of a world and its baked images, read by independent readers and by the formula of the ground."""

import json
import re
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from shapely import Point
from typer.testing import CliRunner

from pavetwin.cli.world import app
from pavetwin.config import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.defects import DefectOptions, place
from pavetwin.errors import PaveTwinError
from pavetwin.scene.export import LEVELS, ExportSummary, TrafficSnapshot, estimate, export_scene, tiles_of
from pavetwin.scene.export.baking import BakedTexture, bake_patch, bake_tile
from pavetwin.scene.foliage import leaf_atlas
from pavetwin.scene.glb import Glb, read_glb
from pavetwin.scene.ground.materials.compose import MapPyramids, surface
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.patches import patch_of
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, GroundKind, GroundMaps, Instance, defect_label, parked_label
from pavetwin.traffic.parked import parked_vehicles
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import Furniture, FurnitureKind, World
from scenes import built, tiny
from scenes.parking import kerb_place, with_places
from scenes.recordings import recording
from scenes.strips import KEY, ORIGIN, STRIP_M, Strips, axes, finish, grain_xy, pothole, pyramids, weathered

TEXEL_M = 0.25
BOUNDS = (1.0, -20.0, 60.0, 20.0)


@cache
def world() -> World:
    street = tiny.street("street", (0.0, 0.0), (64.0, 0.0))
    return tiny.world(
        [street],
        place([street], 2, DefectOptions(population="paper", per_segment=6)),
        buildings=[tiny.block("b", 12.0, 10.0, 24.0, 20.0, 9.0)],
        furniture=[
            Furniture("tree1", FurnitureKind.TREE, Point(40, 8), 9.3, 2.7, clear_height_m=3.1),
            Furniture("tree2", FurnitureKind.TREE, Point(50, 8), 8.3, 3.1, clear_height_m=2.8),
            Furniture("light", FurnitureKind.STREET_LIGHT, Point(31, -4.1), 8.0, 0.1, np.pi / 2, 1.5),
        ],
    )


@cache
def scene() -> Scene:
    return Scene(world(), seed=1)


@cache
def traffic() -> Recording:
    return recording(["suv", "suv", "man"], lambda agent, _: (6.0 + 9 * agent, -1.5, 0.0, 0.0), frames=3)


@dataclass(frozen=True)
class Written:
    path: Path
    made: ExportSummary

    @property
    def glb(self) -> Glb:
        return read_glb(self.path)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    path = tmp_path_factory.mktemp("export") / "street.glb"
    shares: list[float] = []
    made = export_scene(
        scene(),
        path,
        bounds=BOUNDS,
        detail="high",
        texel_m=TEXEL_M,
        moment=TrafficSnapshot(traffic(), 0.5),
        on_progress=shares.append,
    )
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    return Written(path, made)


@cache
def read(path: Path) -> trimesh.Scene:
    return trimesh.load_scene(path, process=False)


def drawn() -> list[Instance]:
    tiles = [scene().tile(key) for key in tiles_of(scene(), BOUNDS)]
    return [*(each for tile in tiles for each in tile.instances), *scene().agents(traffic(), 0.5)]


def to_world(points: np.ndarray, glb: Glb) -> np.ndarray:
    """The file's (n, 3) in the world frame: ours = (z, x, y) of the file, about its origin."""
    x, y = glb.document["asset"]["extras"]["origin_m"]
    return points[:, [2, 0, 1]] + (x, y, 0.0)


def test_another_reader_finds_the_same_triangles(written: Written) -> None:
    tiles = [scene().tile(key) for key in tiles_of(scene(), BOUNDS)]
    expected = sum(len(piece.mesh.indices) for tile in tiles for piece in (*tile.ground, *tile.facades))
    expected += sum(len(patch.mesh.indices) for tile in tiles for patch in scene().patches_on(tile.key))
    expected += sum(len(scene().models[each.model].parts[each.part].indices) for each in drawn())
    found = read(written.path)
    assert sum(len(found.geometry[found.graph[node][1]].faces) for node in found.graph.nodes_geometry) == expected


def test_another_reader_finds_the_same_bounds(written: Written) -> None:
    corners = []
    for key in tiles_of(scene(), BOUNDS):
        tile = scene().tile(key)
        corners += [piece.mesh.positions + (*tile.origin, 0.0) for piece in (*tile.ground, *tile.facades)]
    for each in drawn():
        points = scene().models[each.model].parts[each.part].positions
        corners.append(points @ each.transform[:3, :3].T + each.transform[:3, 3])
    expected = np.concatenate(corners)
    seen = to_world(read(written.path).to_mesh().vertices, written.glb)
    assert seen.min(axis=0)[:2] == pytest.approx(expected.min(axis=0)[:2], abs=1e-3)
    assert seen.max(axis=0) == pytest.approx(expected.max(axis=0), abs=1e-3)


def test_instances_are_nodes_that_share_meshes(written: Written) -> None:
    document = written.glb.document
    nodes = [node for node in document["nodes"] if "matrix" in node and not node["name"].startswith("defect")]
    assert len(nodes) == len(drawn())
    cars = [node for node in nodes if node["name"] == "suv body"]
    assert len(cars) == 2
    geometry = [
        {primitive["attributes"]["POSITION"] for primitive in document["meshes"][car["mesh"]]["primitives"]}
        for car in cars
    ]
    assert geometry[0] == geometry[1]
    assert [car["extras"]["label"] for car in cars] == [1, 2]
    assert written.made.agents == 3


def test_parked_vehicles_are_nodes_with_their_labels(tmp_path: Path) -> None:
    """Those on the tiles that are exported."""
    parked = Scene(with_places(world(), kerb_place(20, 2.4), kerb_place(300, 2.4, name="far")), seed=1)
    stands = parked_vehicles(parked.world, ParkingSettings(occupancy=1.0), Conditions(), 0)
    one_tile = (17.0, 1.0, 23.0, 3.0)
    made = export_scene(parked, tmp_path / "parked.glb", bounds=one_tile, detail="low", texel_m=0.5, parked=stands)
    labels = [node.get("extras", {}).get("label") for node in read_glb(tmp_path / "parked.glb").document["nodes"]]
    assert (made.agents, labels.count(parked_label(0)), labels.count(parked_label(1))) == (1, 1, 0)


def test_crowns_are_cut_by_an_image_of_leaves(written: Written) -> None:
    document = written.glb.document
    cut = [index for index, each in enumerate(document["materials"]) if each.get("alphaMode") == "MASK"]
    crowns = {node["mesh"] for node in document["nodes"] if node["name"].endswith(" crown")}
    primitives = [one for mesh in crowns for one in document["meshes"][mesh]["primitives"]]
    assert {one["material"] for one in primitives} == set(cut) != set()
    assert all("TEXCOORD_0" in one["attributes"] for one in primitives)
    textures = {document["materials"][index]["pbrMetallicRoughness"]["baseColorTexture"]["index"] for index in cut}
    assert len(textures) == 1
    image = document["images"][document["textures"][textures.pop()]["source"]]
    sheet = np.asarray(Image.open(BytesIO(view_bytes(written, image["bufferView"]))))
    assert (sheet[..., 3] == leaf_atlas()[..., 3]).all()


def view_bytes(written: Written, index: int) -> bytes:
    raw = written.path.read_bytes()
    start = 28 + int.from_bytes(raw[12:16], "little")
    view = written.glb.document["bufferViews"][index]
    return raw[start + view["byteOffset"] : start + view["byteOffset"] + view["byteLength"]]


def test_a_car_stands_where_it_stood(written: Written) -> None:
    document = written.glb.document
    (first, _) = (node for node in document["nodes"] if node["name"] == "suv body")
    matrix = np.array(first["matrix"]).reshape(4, 4).T
    assert to_world(matrix[None, :3, 3], written.glb)[0] == pytest.approx([6.0, -1.5, 0.0], abs=1e-5)
    forward = matrix[:3, :3] @ (0, 0, 1)  # a model looks along the file's z
    assert forward == pytest.approx([0, 0, 1], abs=1e-6)
    assert np.linalg.det(matrix[:3, :3]) > 0


def test_every_texture_is_there_and_every_image_opens(written: Written) -> None:
    glb = written.glb
    document = glb.document
    used: list[dict[str, Any]] = []
    for material in document["materials"]:
        pbr = material["pbrMetallicRoughness"]
        used += [pbr[name] for name in ("baseColorTexture", "metallicRoughnessTexture") if name in pbr]
        used += [material["normalTexture"]] if "normalTexture" in material else []
    assert {each["index"] for each in used} == set(range(len(document["textures"])))
    binary = written.path.read_bytes()
    start = 28 + int.from_bytes(binary[12:16], "little")
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        raw = binary[start + view["byteOffset"] : start + view["byteOffset"] + view["byteLength"]]
        with Image.open(BytesIO(raw)) as picture:
            picture.load()
            assert picture.get_format_mimetype() == image["mimeType"]
    for geometry in read(written.path).geometry.values():
        assert geometry.visual.material is not None


def test_the_ground_is_baked_the_right_way_round(written: Written) -> None:
    """Grey where the road is, green next to it, at the place that the ground's own uv names."""
    found = read(written.path)
    name = next(name for name in found.geometry if name.startswith("ground 0 0"))
    geometry = found.geometry[name]
    picture = np.asarray(geometry.visual.material.baseColorTexture.convert("RGB"), dtype=float)
    transform, _ = found.graph[next(node for node in found.graph.nodes_geometry if found.graph[node][1] == name)]
    points = to_world(geometry.vertices @ transform[:3, :3].T + transform[:3, 3], written.glb)
    across = np.polyfit(points[:, 1], geometry.visual.uv[:, 1], 1)
    side = len(picture)

    def at(y_m: float) -> np.ndarray:
        v = np.polyval(across, y_m)  # trimesh counts v upwards
        row = int((1 - v) * side)
        return picture[row, side // 4 : 3 * side // 4].mean(axis=0)

    road, land = at(1.5), at(9.0)
    assert np.ptp(road) < 12
    assert land[1] > land[2] + 12
    assert picture.shape[0] == round(TILE_M / TEXEL_M)


def test_normals_are_unit_and_indices_fit(written: Written) -> None:
    glb = written.glb
    for mesh in glb.document["meshes"]:
        for primitive in mesh["primitives"]:
            normals = glb.array(primitive["attributes"]["NORMAL"])
            assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-3
            indices = glb.array(primitive["indices"])
            assert indices.max() < len(normals)
            assert len(indices) % 3 == 0


def test_normal_maps_have_their_tangents(written: Written) -> None:
    """Unit, in the surface, along the rows of the image; crossed with the normal they give its up: north."""
    glb = written.glb
    ground = [mesh for mesh in glb.document["meshes"] if mesh["name"].startswith("ground")]
    assert len(ground) == written.made.tiles
    for mesh in ground:
        attributes = mesh["primitives"][0]["attributes"]
        tangent, normal = glb.array(attributes["TANGENT"]), glb.array(attributes["NORMAL"])
        assert np.abs(np.linalg.norm(tangent[:, :3], axis=1) - 1).max() < 1e-4
        assert np.abs((tangent[:, :3] * normal).sum(axis=1)).max() < 1e-4
        flat = normal[:, 1] > 0.999
        up = np.cross(normal[flat], tangent[flat, :3]) * tangent[flat, 3:]
        assert np.abs(up - (1, 0, 0)).max() < 0.1  # our north is the file's x
        uv, places = glb.array(attributes["TEXCOORD_0"]), glb.array(attributes["POSITION"])
        assert np.polyfit(places[:, 2], uv[:, 0], 1)[0] > 0  # our east is the file's z
        assert np.polyfit(places[:, 0], uv[:, 1], 1)[0] < 0


def test_every_defect_is_a_node_with_its_label(written: Written) -> None:
    nodes = [node for node in written.glb.document["nodes"] if node["name"].startswith("defect")]
    assert {node["name"] for node in nodes} == {f"defect {defect.id}" for defect in world().defects}
    for node in nodes:
        defect, told = world().defects[int(node["name"].split()[1])], node["extras"]
        assert told["label"] == defect_label(defect.id)
        assert (told["class"], told["severity"], told["segment"]) == (defect.kind, defect.severity, defect.segment)
        assert told["width_m"] == pytest.approx(defect.width_m, abs=1e-4)
    assert written.made.defects == len(world().defects)


def test_the_same_scene_gives_the_same_bytes(written: Written, tmp_path: Path) -> None:
    again = tmp_path / "again.glb"
    moment = TrafficSnapshot(traffic(), 0.5)
    export_scene(Scene(world(), seed=1), again, bounds=BOUNDS, detail="high", texel_m=TEXEL_M, moment=moment)
    assert again.read_bytes() == written.path.read_bytes()


@pytest.mark.slow
def test_more_processes_write_the_same_file(written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.scene.export.glb_file.LEAST_TILES", 1)
    monkeypatch.setattr("pavetwin.scene.export.glb_parts.RUN", 1)
    again, shares = tmp_path / "again.glb", []
    moment = TrafficSnapshot(traffic(), 0.5)
    options = {"bounds": BOUNDS, "detail": "high", "texel_m": TEXEL_M, "moment": moment, "jobs": 2}
    export_scene(scene(), again, **options, on_progress=shares.append)
    assert again.read_bytes() == written.path.read_bytes()
    assert shares == sorted(shares)
    assert len(shares) == written.made.tiles + 1


def test_less_detail_has_the_same_things_in_fewer_bytes(written: Written, tmp_path: Path) -> None:
    """Without normal maps, with the coarse meshes of defects; every defect and object is there, under its label."""
    path, moment = tmp_path / "medium.glb", TrafficSnapshot(traffic(), 0.5)
    made = export_scene(scene(), path, bounds=BOUNDS, texel_m=TEXEL_M, moment=moment)
    medium, high = read_glb(path).document, written.glb.document
    assert made.bytes < written.made.bytes - 50_000
    assert [node["name"] for node in medium["nodes"]] == [node["name"] for node in high["nodes"]]
    assert [node.get("extras") for node in medium["nodes"]] == [node.get("extras") for node in high["nodes"]]
    assert not any("normalTexture" in material for material in medium["materials"])
    assert not any("TANGENT" in each["attributes"] for mesh in medium["meshes"] for each in mesh["primitives"])
    found = trimesh.load_scene(path, process=False)
    assert found.bounds == pytest.approx(read(written.path).bounds, abs=0.02)
    (name,) = {name for name in found.geometry if name.startswith("ground 0 0")}
    uv = [scene.geometry[name].visual.uv for scene in (found, read(written.path))]
    assert uv[0] == pytest.approx(uv[1], abs=1e-4)


def test_the_same_bytes_are_written_once(written: Written) -> None:
    views = range(len(written.glb.document["bufferViews"]))
    kinds = [written.glb.document["bufferViews"][view].get("target") for view in views]
    content = [(kind, view_bytes(written, view)) for view, kind in zip(views, kinds, strict=True)]
    assert len(set(content)) == len(content)


def test_sizes_are_estimated(written: Written) -> None:
    keys = tiles_of(scene(), BOUNDS)
    assert len(keys) == written.made.tiles
    assert written.made.bytes == written.path.stat().st_size
    expected = estimate(scene(), keys, detail="high", texel_m=TEXEL_M)
    assert expected.bytes == pytest.approx(written.made.bytes, rel=0.7)
    low, medium, high = (estimate(scene(), keys, detail=name) for name in ("low", "medium", "high"))
    assert low.bytes < medium.bytes < high.bytes
    assert low.seconds < medium.seconds < high.seconds
    many = [(column, 0) for column in range(400)]
    assert estimate(scene(), many, jobs=2).seconds < 0.7 * estimate(scene(), many).seconds
    level = LEVELS["high"]
    assert level.texel_of(8) == 0.02
    assert 0.02 < level.texel_of(400) < level.texel_of(4000)


def test_what_lies_outside_the_bounds_is_left_out() -> None:
    assert tiles_of(scene(), (33.0, 1.0, 60.0, 20.0)) == ((1, 0),)
    everything = tiles_of(scene())
    assert {(0, 0), (1, 0), (0, -1), (-1, 0)} <= set(everything)
    assert (4, 0) not in everything


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"target": "town.obj"}, "should end in .glb"),
        ({"detail": "medum"}, "did you mean 'medium'"),
        ({"jobs": 0}, "at least one process"),
        ({"texel_m": 0.0}, "not within 0.005"),
        ({"texel_m": 9.0}, "not within 0.005"),
        ({"bounds": (900.0, 900.0, 950.0, 950.0)}, "no streets within these bounds"),
    ],
)
def test_what_can_not_be_written_is_refused(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    target = tmp_path / options.pop("target", "town.glb")
    with pytest.raises(PaveTwinError, match=words):
        export_scene(scene(), target, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_would_be_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.scene.export.glb_file.LARGEST", 1_000_000)
    with pytest.raises(PaveTwinError, match="coarser `texel_m`"):
        export_scene(scene(), tmp_path / "street.glb", texel_m=TEXEL_M)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bounds", "1,2,3"], "four numbers"),
        (["--bounds", "5,0,1,9"], "west must be less"),
        (["--bounds", "0,0,9,9", "--segment", "s0001"], "not both"),
        (["--segment", "nowhere"], "no segment or street 'nowhere'"),
        (["--traffic", "missing.parquet"], "no recording"),
        (["--at", "60"], "--at 60: add a recording"),
        (["--texel", "0"], "not within 0.005"),
        (["--time", "23:00"], "--time: add --parking"),
    ],
)
def test_the_command_refuses_what_makes_no_sense(tmp_path: Path, arguments: list[str], words: str) -> None:
    from pavetwin.world.store import save_world

    save_world(built("grid"), tmp_path / "grid")
    result = CliRunner().invoke(app, ["export", str(tmp_path / "grid"), str(tmp_path / "out.glb"), *arguments])
    assert isinstance(result.exception, PaveTwinError)
    assert words in str(result.exception)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.slow
def test_the_command_writes_and_reports_it(tmp_path: Path) -> None:
    from pavetwin.world.store import save_world

    loaded = save_world(built("grid"), tmp_path / "grid")
    segment = loaded.segments[0].id
    target = tmp_path / "out.glb"
    arguments = [
        "export",
        str(tmp_path / "grid"),
        str(target),
        "--segment",
        segment,
        "--texel",
        "0.5",
        "--parking",
        "1",
    ]
    result = CliRunner().invoke(app, [*arguments, "--dry-run"])
    assert re.match(r"\d+ tiles of 32 m at medium detail: about \d+ MB, \d+ s on an idle machine\.\n$", result.stdout)
    assert not target.exists()
    result = CliRunner().invoke(app, arguments)
    assert result.exception is None, result.output
    assert target.read_bytes()[:4] == b"glTF"
    assert json.dumps(read_glb(target).document["asset"]["extras"]["texel_m"]) == "0.5"
    assert "50 cm per texel" in result.output
    parked = re.search(r"(\d+) agents and parked vehicles", result.output)
    assert parked is not None
    assert int(parked[1]) > 3


GROUND_TEXEL_M = 0.032


@cache
def baked() -> BakedTexture:
    return bake_tile(Strips().tile(KEY), pyramids(), GROUND_TEXEL_M)


@pytest.mark.parametrize("kind", GroundKind, ids=lambda kind: kind.name)
def test_grain_is_baked_along_the_images_axes_whichever_way_it_lies(kind: GroundKind) -> None:
    picture = baked()
    side = len(picture.colour)
    x, y = np.meshgrid((np.arange(side) + 0.5) * TILE_M / side, TILE_M - (np.arange(side) + 0.5) * TILE_M / side)
    inside = (np.abs(y - (kind + 0.5) * STRIP_M) < STRIP_M / 2 - 0.1) & (x < 8.0)
    local = np.column_stack([x[inside], y[inside]])
    found = surface(kind, grain_xy(kind, local), local, ORIGIN, pyramids(), TILE_M / side, finish(kind))
    assert np.abs(picture.colour[inside] - 255 * srgb_of_linear(found.albedo)).max() < 1.5
    bent = (picture.normal[inside].astype(float)[:, :2] - 128) / 127
    assert np.abs(bent - found.normal[:, :2] @ axes(kind)).max() < 0.006


def test_no_paint_lies_on_the_floor_of_a_baked_pothole() -> None:
    patch = patch_of(pothole())
    painted, unpainted = weathered().drawn.copy(), weathered().drawn.copy()
    painted[...], unpainted[..., 0], unpainted[..., 3] = (255, 0, 0, 1), 1, 1
    seen, bare = (
        bake_patch(patch, ORIGIN, MapPyramids.of(GroundMaps(weathered().weathering, drawn)), 0.005).colour.astype(int)
        for drawn in (painted, unpainted)
    )
    floor = patch.lost[::-1] == 255
    assert floor.sum() > 500
    assert np.array_equal(seen[floor], bare[floor])
    assert (seen - bare)[patch.lost[::-1] == 0].mean() > 50

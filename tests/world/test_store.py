"""Worlds on disk: exact round trip, same bytes, condition of segments, and messages about damage."""

import filecmp
import shutil
from dataclasses import replace
from pathlib import Path

import pyogrio
import pytest
import yaml

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.draw.condition_maps import DENSITY_COLOURS, STEPS, save_condition_map, shade_of
from pavetwin.errors import PaveTwinError
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.condition import condition_columns, condition_of
from pavetwin.world.folder import FILES, check_target
from pavetwin.world.model import Direction, Furniture, FurnitureKind, World
from pavetwin.world.store import load_record, load_world, save_world
from scenes import built, scene_file

FEW = DefectOptions(population="paper", per_segment=1)


@pytest.fixture
def saved(tmp_path: Path) -> World:
    return save_world(add_defects(built("cross"), FEW), tmp_path / "world")


@pytest.mark.parametrize("name", ["cross", "berlin_neukoelln", "town"])
def test_a_loaded_world_equals_the_saved_one(name: str, tmp_path: Path) -> None:
    made = add_defects(built(name), FEW)
    world = save_world(made, tmp_path / "place" / name)
    loaded = load_world(tmp_path / "place" / name)
    assert loaded == world
    assert loaded.content_hash == made.world.content_hash
    assert load_record(tmp_path / "place" / name) == made.record
    assert loaded.network_file.read_bytes() == made.network
    assert sorted(path.name for path in (tmp_path / "place").iterdir()) == [name]


@pytest.mark.parametrize("name", ["cross", "grid"])
def test_the_same_seed_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    source = scene_file(name) if name == "cross" else name
    for copy in ("one", "two"):
        save_world(add_defects(build_world(source, BuildOptions(seed=0)), FEW), tmp_path / copy)
    same, differing, _ = filecmp.cmpfiles(tmp_path / "one", tmp_path / "two", FILES, shallow=False)
    assert (sorted(same), differing) == (sorted(FILES), [])


def test_the_geopackage_opens_with_its_crs_and_sensible_columns(saved: World) -> None:
    assert saved.folder is not None
    path = saved.folder / "world.gpkg"
    layers = {name for name, _ in pyogrio.list_layers(path)}
    assert layers >= {"segments", "lanes", "sidewalks", "junctions", "crossings", "buildings", "furniture", "defects"}
    info = pyogrio.read_info(path, layer="segments")
    assert info["crs"] == "EPSG:32633"
    assert {"id", "street", "width_m", "lanes", "length_m", "area_m2"} <= set(info["fields"])
    west, south, east, north = info["total_bounds"]
    assert 362_000 < west < east < 364_000
    assert 5_762_000 < south < north < 5_764_000


def test_defects_do_not_change_the_content_hash(tmp_path: Path) -> None:
    made = built("cross")
    bare = save_world(made, tmp_path / "bare")
    full = save_world(add_defects(made, FEW), tmp_path / "full")
    assert bare.content_hash == full.content_hash
    assert bare.defects != full.defects


def test_an_edited_world_is_another_world(tmp_path: Path) -> None:
    made = built("cross")
    world, mast = made.world, Furniture("x", FurnitureKind.POLE, made.world.base, 9.0, 0.1)
    turned = replace(world.connections[0], direction=Direction.TURNAROUND)
    edits = {
        "furniture": replace(world, furniture=(*world.furniture, mast)),
        "parking": replace(world, parking=world.parking[1:]),
        "connections": replace(world, connections=(turned, *world.connections[1:])),
    }
    for name, edited in edits.items():
        save_world(replace(made, world=edited), tmp_path / name)
        assert load_world(tmp_path / name).content_hash != world.content_hash, name


@pytest.mark.parametrize("name", FILES)
def test_a_half_deleted_world_names_what_is_missing(saved: World, name: str) -> None:
    assert saved.folder is not None
    (saved.folder / name).unlink()
    with pytest.raises(PaveTwinError, match=f"{name} is missing.* --force`"):
        load_world(saved.folder)


def test_other_damage_is_one_plain_line(saved: World, tmp_path: Path) -> None:
    folder = saved.folder
    assert folder is not None

    def spoilt(change: str) -> Path:
        copy = tmp_path / change
        shutil.copytree(folder, copy)
        return copy

    half = spoilt("half")
    (half / "world.gpkg").write_bytes((folder / "world.gpkg").read_bytes()[:50_000])
    newer = spoilt("newer")
    (newer / "world.yaml").write_text("format: 99\n")
    torn = spoilt("torn")
    (torn / "world.yaml").write_text("format: [1\n")
    bare = spoilt("bare")
    (bare / "world.yaml").write_text(yaml.safe_dump({"format": 1}))
    empty = tmp_path / "empty"
    empty.mkdir()
    for place, word in (
        (half, "readable layer"),
        (newer, "format 99"),
        (torn, "cannot be read"),
        (bare, "damaged"),
        (empty, "not a world"),
        (tmp_path / "nowhere", "does not exist"),
        (folder / "world.gpkg", "not a folder"),
    ):
        with pytest.raises(PaveTwinError, match=word) as caught:
            load_world(place)
        assert "\n" not in str(caught.value)


def test_only_a_world_is_replaced_and_only_by_force(saved: World, tmp_path: Path) -> None:
    assert saved.folder is not None
    with pytest.raises(PaveTwinError, match="`force`"):
        save_world(built("cross"), saved.folder)
    assert load_world(saved.folder) == saved
    again = save_world(built("cross"), saved.folder, force=True)
    assert load_world(saved.folder) == again
    other = tmp_path / "other"
    other.mkdir()
    (other / "diary.txt").write_text("mine")
    with pytest.raises(PaveTwinError, match="not a world"):
        check_target(other, force=True)
    assert (other / "diary.txt").is_file()


def test_an_unwritable_place_is_refused_and_nothing_left(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    for refusing in (lambda: check_target(blocked / "world"), lambda: save_world(built("cross"), blocked / "world")):
        with pytest.raises(PaveTwinError, match="Cannot write"):
            refusing()
    check_target(tmp_path / "free" / "world")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_path_may_be_a_plain_string(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "town.osm").write_bytes(scene_file("cross").read_bytes())
    (tmp_path / "grid").write_text("a file of a kind's name does not hide the kind")
    from_map = build_world("town.osm", BuildOptions(seed=1))
    assert from_map.record.source == "town.osm"
    saved = save_world(from_map, "mine")
    assert load_world("mine") == saved
    assert load_record("mine") == from_map.record
    assert build_world("grid", BuildOptions(seed=1)).record.source == "generated grid"
    with pytest.raises(PaveTwinError, match="does not exist"):
        build_world("nowhere.osm")


DAMAGED = add_defects(built("cross"), DefectOptions(population="survey", per_100_m2=3))


def test_each_segment_has_the_extent_of_its_own_defects() -> None:
    world = DAMAGED.world
    for each in condition_of(world):
        own = [defect for defect in world.defects if defect.segment == each.segment.id]
        cracks = [defect for defect in own if defect.kind == "single_crack"]
        assert each.number == len(own)
        assert each.of("single_crack").number == len(cracks)
        assert each.of("single_crack").length_m == pytest.approx(sum(defect.length_m for defect in cracks))
        assert each.damaged_share == pytest.approx(sum(d.polygon.area for d in own) / each.segment.polygon.area)
        assert each.per_100_m2 == pytest.approx(100 * len(own) / each.segment.polygon.area)
        assert each.of("no_such_class").number == 0


def test_the_geopackage_has_it_as_a_layer(tmp_path: Path) -> None:
    save_world(DAMAGED, tmp_path / "w")
    meta, _, shapes, columns = pyogrio.raw.read(tmp_path / "w" / "world.gpkg", layer="condition")
    table = dict(zip(meta["fields"], columns, strict=True))
    assert len(shapes) == len(DAMAGED.world.segments)
    assert table["defects"].sum() == len(DAMAGED.world.defects)
    assert table["segment"].tolist() == [segment.id for segment in DAMAGED.world.segments]
    assert set(table) == set(condition_columns(DAMAGED.world))
    assert table["single_crack_number"].sum() == sum(d.kind == "single_crack" for d in DAMAGED.world.defects)


def test_shades_go_from_sound_to_worn(tmp_path: Path) -> None:
    assert [shade_of(value) for value in (0.0, 0.99, 1.0, 3.9, 8.0, 100.0)] == [0, 0, 1, 2, 4, 4]
    assert len(DENSITY_COLOURS) == len(STEPS) + 1
    save_condition_map(DAMAGED.world, tmp_path / "condition.svg")
    text = (tmp_path / "condition.svg").read_text(encoding="utf-8").lower()
    used = {DENSITY_COLOURS[shade_of(each.per_100_m2)].lower() for each in condition_of(DAMAGED.world)}
    assert len(used) > 1
    assert all(text.count(colour) > 1 for colour in used), "each shade is on the map and in the legend"

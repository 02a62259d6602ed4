"""Looks of streets from data files: what a street is paved with, and what is wrong with a file in one line."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.layout.relief import Relief
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.mesh.ground_mesh import faces_of
from pavetwin.scene.ground.styles import pavement, street_style, style_names, style_sha256
from pavetwin.scene.ground.styles.pavement import pavement_names
from pavetwin.scene.ground.styles.street_style import RepairMaterials
from pavetwin.scene.patches import holes_of
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, GroundKind
from pavetwin.world.model import World
from scenes import built, tiny

BLUE = {
    "title": "blue",
    "material": "asphalt",
    "reflectance": {"new": 0.1, "aged": 0.1, "spread": 0.0},
    "tint": {"red": 0.7, "blue": 1.4, "spread": 0.0},
    "grain": {"least": 0.5, "most": 0.5},
}
LOOK = {"title": "one", "main": {"concrete": 1}, "other": {"concrete": 1}}
STRETCHES = {"share": 0.0, "pavements": {"overlay": 1}}


def written(path: Path, values: dict[str, object]) -> str:
    path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return str(path)


def style_of(folder: Path, name: str) -> str:
    """A style with one pavement everywhere."""
    values = LOOK | {"main": {name: 1}, "other": {name: 1}, "stretches": STRETCHES}
    return written(folder / "style.yaml", values)


def world() -> World:
    return tiny.straight()


def plan(style: str) -> GroundPlan:
    return plan_ground(world(), 3, holes_of(world().defects), street_style(style))


def tile_on_street() -> tuple[int, int]:
    point = world().segments[0].centre_line.interpolate(0.5, normalized=True)
    return int(point.x // TILE_M), int(point.y // TILE_M)


@pytest.mark.parametrize("name", style_names())
def test_every_look_names_pavements_that_are_there(name: str) -> None:
    style = street_style(name)
    drawn = {
        style.pavement(main=main, chance=chance).title for main in (True, False) for chance in np.linspace(0, 1, 201)
    }
    assert len(drawn) == len({*style.main, *style.other})


@pytest.mark.parametrize("main", [True, False])
def test_a_street_without_slabs_gets_another_of_the_pavements_if_there_is_one(main: bool) -> None:
    """For every random number, and the others as often as their weights say."""
    tables = {"main": {"concrete": 4.0, "overlay": 1.0, "red_asphalt": 3.0}, "other": {"concrete": 1.0, "overlay": 1.0}}
    style = street_style("uniform").model_copy(update=tables)
    chances = np.linspace(0.0, 0.999, 200)
    found = Counter(style.pavement(main=main, chance=chance, slabs=False).title for chance in chances)
    weights = {pavement(name).title: weight for name, weight in tables["main" if main else "other"].items()}
    del weights[pavement("concrete").title]
    assert found == pytest.approx({title: 200 * each / sum(weights.values()) for title, each in weights.items()}, abs=1)
    assert {style.pavement(main=main, chance=chance).title for chance in chances} > set(found)
    slabs_only = style.model_copy(update={"main": {"concrete": 1.0}, "other": {"concrete": 1.0, "overlay": 0.0}})
    assert slabs_only.pavement(main=main, chance=0.5, slabs=False) == pavement("concrete")


def test_pavements_range_from_near_black_to_pale() -> None:
    middles = {name: pavement(name).reflectance.at(pavement(name).age.at(0.5), 0.5) for name in pavement_names()}
    assert min(middles.values()) < 0.08
    assert max(middles[name] for name in middles if pavement(name).material == "asphalt") > 0.18
    assert {pavement(name).material.ground for name in middles} >= {GroundKind.CHIP_SEAL, GroundKind.SLABS}


def test_a_street_is_meshed_of_what_its_look_says(tmp_path: Path) -> None:
    found = plan(style_of(tmp_path, "concrete"))
    kinds = {piece.kind for piece in ground_pieces(found, tile_on_street())}
    assert GroundKind.SLABS in kinds
    assert GroundKind.ASPHALT not in kinds
    assert len(found.repairs.seals) > world().segments[0].length_m / 4.5  # joints between slabs


def agreed(there: GroundPlan, keys: Iterable[tuple[int, int]]) -> int:
    """The number of materials in some tiles, each where the maps' tone is that of its pavement."""
    seen = set()
    for key in keys:
        for face in faces_of(there, key, Relief(there, tile_box(key))):
            if face.kind in (GroundKind.ASPHALT, GroundKind.CHIP_SEAL, GroundKind.SLABS):
                inner = face.polygon.representative_point()
                assert (face.kind, face.finish) == there.paved_at(inner.x, inner.y).material
                seen.add((face.kind, face.finish))
    return len(seen)


def test_meshes_and_maps_agree_which_pavement_is_where() -> None:
    town = plan_ground(built("seattle_roosevelt").world, 3)
    middles = [segment.centre_line.interpolate(0.4, normalized=True) for segment in town.world.segments[::9]]
    assert agreed(town, {(int(point.x // TILE_M), int(point.y // TILE_M)) for point in middles}) > 4


def test_they_agree_where_one_pavement_covers_all_of_another() -> None:
    narrow = tiny.street("narrow", (5.0, 10.0), (15.0, 10.0), width_m=5.0)
    there = tiny.world([narrow, tiny.street("broad", (-5.0, 10.0), (60.0, 10.0), width_m=14.0)])
    without_repairs = street_style("varied").model_copy(update={"repairs": RepairMaterials()})
    plans = (plan_ground(there, seed, style=without_repairs) for seed in range(50))
    differing = next(each for each in plans if len({each.pavement(street).material for street in each.streets}) > 1)
    assert agreed(differing, [(0, 0)]) == 1


def test_a_look_may_name_a_pavement_beside_it(tmp_path: Path) -> None:
    written(tmp_path / "blue.yaml", BLUE)
    found = plan(style_of(tmp_path, "blue.yaml"))
    (piece,) = (each for each in ground_pieces(found, tile_on_street()) if each.kind is GroundKind.ASPHALT)
    assert piece.finish == pytest.approx((0.7, 1.4, 0.5, 0.1 / 0.135), abs=1 / 128)
    x, y = world().segments[0].centre_line.interpolate(0.5, normalized=True).coords[0]
    assert found.paved_at(x, y).reflectance == pytest.approx(0.1, rel=0.01)


def test_the_pavement_around_a_defect_is_that_of_its_street(tmp_path: Path) -> None:
    there = tiny.straight((20.0, 1.0))
    scene = Scene(there, seed=3, style=style_of(tmp_path, "concrete"))
    patch = scene.patch_on((0, 0), 0)
    assert patch is not None
    assert patch.kind is GroundKind.SLABS


def test_a_look_changes_no_label() -> None:
    """Repairs, markings and what hangs over a street leave holes and masks of defects as they are."""
    there = tiny.straight(*((6.0 + 5.0 * k, (k % 3 - 1) * 2.0) for k in range(10)))
    scenes = [Scene(there, seed=3, style=style) for style in ("uniform", "varied")]
    for key in ((0, -1), (0, 0), (1, -1), (1, 0)):
        plain, varied = (dict(scene.holes_on(key)) for scene in scenes)
        assert plain == varied
        for number in plain:
            masks = [part.mask for scene in scenes if (part := scene.patch_on(key, number)) is not None]
            assert all(np.array_equal(mask, masks[0]) for mask in masks)
            assert len(masks) in (0, 2)


def test_the_hash_of_a_look_covers_its_pavements(tmp_path: Path) -> None:
    hashes = set()
    for number, red in enumerate((0.7, 0.8)):
        folder = tmp_path / str(number)
        folder.mkdir()
        written(folder / "blue.yaml", BLUE | {"tint": {"red": red}})
        hashes.add(style_sha256(style_of(folder, "blue.yaml")))
    assert len(hashes) == 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"materiel": "asphalt"}, "unknown key 'materiel' (did you mean 'material'?)"),
        ({"material": "gravel"}, "material: "),
        ({"reflectance": {"new": 0.9, "aged": 0.1}}, "reflectance.new: "),
        ({"age": {"least": 0.9, "most": 0.2}}, "age: least 0.9 is larger than most 0.2"),
        ({"grain": {"least": 0.1, "most": 3.0}}, "grain: least and most lie between 0 and 1.9"),
    ],
)
def test_a_mistake_in_a_pavement_is_one_line_with_its_place(
    tmp_path: Path, change: dict[str, object], told: str
) -> None:
    path = written(tmp_path / "mine.yaml", BLUE | change)
    with pytest.raises(PaveTwinError) as caught:
        pavement(path)
    message = str(caught.value)
    assert path in message
    assert told in message
    assert "\n" not in message


def test_a_number_of_wires_is_whole(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"overhead\.wires: least and most are whole numbers\.$"):
        street_style(
            written(
                tmp_path / "style.yaml",
                LOOK | {"stretches": STRETCHES, "overhead": {"wires": {"least": 1.5, "most": 2}}},
            )
        )


def test_a_file_that_does_not_end_in_yaml_is_named_with_what_would(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"no street style '.*style\.txt'; known are .*name ends in \.yaml\.$"):
        street_style(written(tmp_path / "style.txt", LOOK))


def test_a_look_says_which_of_its_pavements_is_not_known(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"style\.yaml', line 3: main: no pavement 'tarmac'[^`]*$"):
        street_style(style_of(tmp_path, "tarmac"))

"""Styles of streets from data files: pavements, sidewalks, and mistakes in one line."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import ndimage

from pavetwin.config.named import names_in
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.layout.relief import Relief
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.materials.detail_textures import details
from pavetwin.scene.ground.mesh.ground_mesh import faces_of
from pavetwin.scene.ground.styles import StreetStyle, mark, pavement, street_style, style_names, style_sha256
from pavetwin.scene.ground.styles.marking_standard import marking_standard
from pavetwin.scene.ground.styles.pavement import PACKAGE
from pavetwin.scene.ground.styles.street_style import RepairMaterials, SidewalkPaving, SidewalkStyle
from pavetwin.scene.patches import holes_of
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, Finish, GroundKind
from pavetwin.world.model import LaneKind, World
from scenes import built, tiny

BLUE = {
    "title": "blue",
    "material": "asphalt",
    "reflectance": {"new": 0.1, "aged": 0.1, "spread": 0.0},
    "tint": {"red": 0.7, "blue": 1.4, "spread": 0.0},
    "grain": {"least": 0.5, "most": 0.5},
}
STYLE = {"title": "one", "main": {"concrete": 1}, "other": {"concrete": 1}}
STRETCHES = {"share": 0.0, "pavements": {"overlay": 1}}


def written(path: Path, values: dict[str, object]) -> str:
    path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return str(path)


def style_of(folder: Path, name: str) -> str:
    """A style with one pavement everywhere."""
    values = STYLE | {"main": {name: 1}, "other": {name: 1}, "stretches": STRETCHES}
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
    middles = {
        name: pavement(name).reflectance.at(pavement(name).age.at(0.5), 0.5) for name in names_in(PACKAGE, "pavements")
    }
    assert min(middles.values()) < 0.08
    assert max(middles[name] for name in middles if pavement(name).material == "asphalt") > 0.18
    assert {pavement(name).material.ground for name in middles} >= {GroundKind.CHIP_SEAL, GroundKind.SLABS}


def test_a_street_is_meshed_of_what_its_look_states(tmp_path: Path) -> None:
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


def test_a_style_may_name_a_pavement_next_to_it(tmp_path: Path) -> None:
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


def test_a_style_changes_no_label() -> None:
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


def test_a_file_that_does_not_end_in_yaml_is_named_with_what_would(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"no street style '.*style\.txt'; known are .*name ends in \.yaml\.$"):
        street_style(written(tmp_path / "style.txt", STYLE))


def test_the_hash_of_a_style_covers_the_files_that_it_names_and_not_their_folder(tmp_path: Path) -> None:
    standard = marking_standard("germany").model_dump(mode="json")

    def hash_of(folder: str, red: float = 0.7, colour: str = "white", weight: int = 1) -> str:
        (tmp_path / folder).mkdir(exist_ok=True)
        written(tmp_path / folder / "blue.yaml", BLUE | {"tint": {"red": red}})
        written(tmp_path / folder / "mine.yaml", standard | {"centre_colour": colour})
        parts = {"repairs": {"patches": {"own": 1, "overlay": weight}}, "markings": "mine.yaml"}
        values = STYLE | {"main": {"blue.yaml": 1}, "stretches": STRETCHES} | parts
        return style_sha256(written(tmp_path / folder / "style.yaml", values))

    assert hash_of("here") == hash_of("there")
    assert len({hash_of("0"), hash_of("1", red=0.8), hash_of("2", colour="red"), hash_of("3", weight=2)}) == 4


MARK = {"title": "mine", "colours": {"red": 1}, "strokes": [[[0, 0], [1, 0]]], "width_m": 0.1, "position": "anywhere"}
MARK |= {"wear": {"least": 0.1, "most": 0.5}}


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (pavement, {"materiel": "asphalt"}, "unknown key 'materiel' (did you mean 'material'?)"),
        (pavement, {"material": "gravel"}, "material: "),
        (pavement, {"reflectance": {"new": 0.9, "aged": 0.1}}, "reflectance.new: "),
        (pavement, {"age": {"least": 0.9, "most": 0.2}}, "age: least 0.9 is larger than most 0.2"),
        (pavement, {"grain": {"least": 0.1, "most": 3.0}}, "grain: least and most lie between 0 and 1.9"),
        (mark, {"position": "roof"}, "position: "),
        (mark, {"wear": {"least": 0.1, "most": 1.5}}, "wear: least and most lie between 0 and 0.95"),
        (mark, {"colours": {"pink": 1}}, "colours.pink"),
        (mark, {"strokes": [[[0, 0]]]}, "strokes.1"),
        (mark, {"strokes": [[[0, 0], [1, 0, 0]]]}, "strokes.1.2: give at most 2, not 3."),
        (mark, {"strokes": 0.1}, "strokes: it must be a list (got 0.1)."),
        (marking_standard, {"line_m": 12}, "line_m: "),
        (marking_standard, {"hatching": {"angle_deg": 90}}, "hatching.angle_deg: "),
        (marking_standard, {"box": {"every_m": 1}}, "box.share: "),
        (marking_standard, {"rumble": {"kind": "glued", "bar_m": [0.1, 0.1], "bars": 3}}, "rumble.kind: "),
        (street_style, {"main": {"tarmac": 1}}, "main: no pavement 'tarmac'"),
        (street_style, {"repairs": {"patches": {"tar": 1}}}, "repairs.patches: no pavement 'tar'"),
        (street_style, {"repairs": {"patches": {"own": 0}}}, "repairs.patches: the weights sum to 0"),
        (street_style, {"repairs": {"renewed": 2}}, "repairs.renewed: "),
        (street_style, {"overhead": {"wires": {"least": 1.5, "most": 2}}}, "least and most are whole numbers."),
        (street_style, {"markings": "atlantis"}, "'atlantis'"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_with_its_place(
    tmp_path: Path, kind: Callable[[str], object], change: dict[str, object], message: str
) -> None:
    standard = marking_standard("germany").model_dump(mode="json")
    whole = {pavement: BLUE, mark: MARK, marking_standard: standard, street_style: STYLE | {"stretches": STRETCHES}}
    path = written(tmp_path / "mine.yaml", whole[kind] | change)
    with pytest.raises(PaveTwinError) as caught:
        kind(path)
    text = str(caught.value)
    assert f"{path}', line " in text
    assert message in text
    assert "\n" not in text


PIECES = {GroundKind.BLOCKS: 128, GroundKind.TILES: 64, GroundKind.SETTS: 256}


def with_sidewalks(**settings: object) -> StreetStyle:
    return street_style("uniform").model_copy(update={"sidewalks": SidewalkStyle.model_validate(settings)})


def paved(style: StreetStyle, name: str = "cross") -> GroundPlan:
    return plan_ground(built(name).world, 3, style=style)


@pytest.mark.parametrize("kind", PIECES)
def test_a_texture_has_whole_pieces_where_it_repeats(kind: GroundKind) -> None:
    """Pieces between joints, counted over the edges of the texture."""
    relief = details()[kind].relief[..., 2].astype(float)
    stones = relief > np.median(relief) * 0.6
    number, _ = ndimage.label(np.tile(stones, (2, 2)))
    whole = np.bincount(number.ravel())[1:]
    repeated = (whole > 0.3 * np.median(whole)).sum() / 4
    assert repeated == pytest.approx(PIECES[kind], rel=0.2)  # those at the rim of the two by two are counted twice
    across = np.abs(np.diff(np.tile(relief, (1, 2)), axis=1)).mean(axis=0)
    assert across[relief.shape[1] - 1] < 3 * np.percentile(across, 90)


def test_a_street_has_one_paving_on_both_sides_and_streets_differ() -> None:
    where = paved(with_sidewalks(pavings={"blocks": 1, "setts": 1, "tiles": 1}, red=0.5), "seattle_roosevelt")
    lanes = where.world.lanes_of(LaneKind.SIDEWALK)
    streets = {edge: street.name for street in where.world.streets for edge in street.edges}
    found: dict[str, set[tuple[GroundKind, Finish]]] = defaultdict(set)
    for lane, surface in zip(lanes, where.walk_surfaces, strict=True):
        found[streets.get(lane.edge, lane.edge)].add(surface)
    assert max(map(len, found.values())) == 1
    assert {kind for surfaces in found.values() for kind, _ in surfaces} == {
        GroundKind.BLOCKS,
        GroundKind.SETTS,
        GroundKind.TILES,
    }


@pytest.mark.parametrize("paving", SidewalkPaving)
def test_a_style_paves_sidewalks(paving: SidewalkPaving) -> None:
    where = paved(with_sidewalks(pavings={paving.value: 1}))
    x, y = where.sidewalk_lines[0].interpolate(0.4, normalized=True).coords[0]
    pieces = ground_pieces(where, (int(x // TILE_M), int(y // TILE_M)))
    kinds = {piece.kind for piece in pieces}
    others = {each.ground for each in SidewalkPaving} - {paving.ground, GroundKind.CONCRETE, GroundKind.PAVING}
    assert paving.ground in kinds
    assert not others & kinds


def test_red_is_of_blocks_and_tiles_only() -> None:
    for paving in SidewalkPaving:
        surfaces = paved(with_sidewalks(pavings={paving.value: 1}, red=1.0)).walk_surfaces
        assert all((finish.red > 1.2) == (paving in ("blocks", "tiles")) for _, finish in surfaces)


def test_tone_is_the_factor_on_the_reflectance() -> None:
    surfaces = paved(with_sidewalks(pavings={"setts": 1}, tone={"least": 0.5, "most": 0.75})).walk_surfaces
    assert all(0.5 <= finish.tone <= 0.75 for _, finish in surfaces)
    assert len({finish.tone for _, finish in surfaces}) > 1

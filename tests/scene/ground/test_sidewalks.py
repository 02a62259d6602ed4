"""What sidewalks are paved with."""

from collections import defaultdict

import numpy as np
import pytest
from scipy import ndimage

from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.materials.detail_textures import details
from pavetwin.scene.ground.styles import StreetStyle, street_style
from pavetwin.scene.ground.styles.street_style import SidewalkPaving, SidewalkStyle
from pavetwin.scene.values import TILE_M, Finish, GroundKind
from pavetwin.world.model import LaneKind
from scenes import built

PIECES = {GroundKind.BLOCKS: 128, GroundKind.TILES: 64, GroundKind.SETTS: 256}


def with_sidewalks(**settings: object) -> StreetStyle:
    return street_style("uniform").model_copy(update={"sidewalks": SidewalkStyle.model_validate(settings)})


def plan(style: StreetStyle, name: str = "cross") -> GroundPlan:
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
    where = plan(with_sidewalks(pavings={"blocks": 1, "setts": 1, "tiles": 1}, red=0.5), "seattle_roosevelt")
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
    where = plan(with_sidewalks(pavings={paving.value: 1}))
    x, y = where.sidewalk_lines[0].interpolate(0.4, normalized=True).coords[0]
    pieces = ground_pieces(where, (int(x // TILE_M), int(y // TILE_M)))
    kinds = {piece.kind for piece in pieces}
    others = {each.ground for each in SidewalkPaving} - {paving.ground, GroundKind.CONCRETE, GroundKind.PAVING}
    assert paving.ground in kinds
    assert not others & kinds


def test_red_is_of_blocks_and_tiles_only() -> None:
    for paving in SidewalkPaving:
        surfaces = plan(with_sidewalks(pavings={paving.value: 1}, red=1.0)).walk_surfaces
        assert all((finish.red > 1.2) == (paving in ("blocks", "tiles")) for _, finish in surfaces)


def test_tone_is_the_factor_on_the_reflectance() -> None:
    surfaces = plan(with_sidewalks(pavings={"setts": 1}, tone={"least": 0.5, "most": 0.75})).walk_surfaces
    assert all(0.5 <= finish.tone <= 0.75 for _, finish in surfaces)
    assert len({finish.tone for _, finish in surfaces}) > 1

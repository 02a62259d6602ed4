"""What lies on the ground: markings where lanes are, maps that agree across tiles, grain without a seam."""

from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.scene.ground import GroundPlan, details, ground_maps, plan_ground
from pavetwin.scene.ground.distractors.segment_marks import SEAM_HALF_M, Repairs
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.markings.painter import paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.materials.compose import PAINTS, surface
from pavetwin.scene.ground.materials.grain import blurred
from pavetwin.scene.ground.materials.sampling import Pyramid, linear_of_srgb, srgb_of_linear
from pavetwin.scene.values import MAP_MARGIN_M, MAP_PX, SIGNED_DISTANCE_M, TILE_M, GroundKind, GroundMaps
from scenes import built, tiny

TEXEL_M = (TILE_M + 2 * MAP_MARGIN_M) / MAP_PX
MEANS = {
    GroundKind.ASPHALT: (0.10, 0.20),
    GroundKind.CONCRETE: (0.25, 0.40),
    GroundKind.PAVING: (0.20, 0.40),
    GroundKind.KERB: (0.20, 0.40),
    GroundKind.GRASS: (0.05, 0.15),
    GroundKind.EARTH: (0.08, 0.25),
    GroundKind.CHIP_SEAL: (0.10, 0.20),
    GroundKind.SLABS: (0.25, 0.40),
    GroundKind.BLOCKS: (0.20, 0.30),
    GroundKind.TILES: (0.20, 0.30),
    GroundKind.SETTS: (0.15, 0.25),
}


@cache
def plan(name: str, seed: int = 3) -> GroundPlan:
    return plan_ground(built(name).world, seed)


@cache
def maps(name: str, key: tuple[int, int]) -> GroundMaps:
    return ground_maps(plan(name), key)


def key_at(x: float, y: float) -> tuple[int, int]:
    return int(x // TILE_M), int(y // TILE_M)


def painted(name: str, key: tuple[int, int]) -> np.ndarray:
    """World positions (n, 2) of texels inside paint."""
    rows, columns = np.nonzero(maps(name, key).drawn[..., 0] > 128)
    local = (np.column_stack([columns, rows]) + 0.5) * TEXEL_M - MAP_MARGIN_M
    return local + np.array(key) * TILE_M


def sampled(values: np.ndarray, key: tuple[int, int], xy: np.ndarray) -> np.ndarray:
    uv = (xy - np.array(key) * TILE_M + MAP_MARGIN_M) / (TILE_M + 2 * MAP_MARGIN_M)
    return Pyramid.of(values.astype(np.float32), wraps=False).sample(uv, 0.0)


def drawn_at(name: str, x: float, y: float) -> int:
    """The coded signed distance to paint at a point of the world."""
    key = key_at(x, y)
    column, row = ((np.array([x, y]) - np.array(key) * TILE_M + MAP_MARGIN_M) / TEXEL_M).astype(int)
    return int(maps(name, key).drawn[row, column, 0])


def test_the_mark_of_a_locked_wheel_grows_from_nothing_and_fades_where_it_ends() -> None:
    one = plan_ground(tiny.straight(length_m=30.0), 3)
    (x, y), length = one.world.segments[0].centre_line.coords[0], 8.0
    line = np.column_stack([np.linspace(x + 6.0, x + 6.0 + length, 6), np.full(6, y + 1.0)])
    marked = plan_ground(one.world, 3)
    one.__dict__["repairs"], marked.__dict__["repairs"] = Repairs(), Repairs(skids=[(line, 0.4)])
    key = key_at(*line.mean(axis=0).tolist())
    at = np.column_stack([line[0, 0] + length * np.array([0.01, 0.2, 0.5, 0.9, 0.995]), np.full(5, y + 1.0)])
    clean, dark = (sampled(ground_maps(each, key).weathering, key, at)[:, 1] for each in (one, marked))
    start, growing, middle, nearly, end = (dark - clean).tolist()
    assert middle == pytest.approx(nearly, abs=3)
    assert middle > 60
    assert 0.2 * middle < growing < 0.8 * middle
    assert max(start, end) < 0.1 * middle


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cross", "berlin_neukoelln", "seattle_roosevelt"])
def test_neighbours_agree_where_they_overlap(name: str) -> None:
    segment = max(built(name).world.segments, key=lambda segment: segment.width_m)
    spot = segment.centre_line.interpolate(0.4, normalized=True)
    column, row = key_at(spot.x, spot.y)
    for other, border in (((column + 1, row), 0), ((column, row + 1), 1)):
        xy = np.zeros((4000, 2))
        xy[:, border] = other[border] * TILE_M + np.tile([-0.3, -0.1, 0.1, 0.3], 1000)
        xy[:, 1 - border] = (column, row)[1 - border] * TILE_M + np.linspace(0.3, TILE_M - 0.3, 4000)
        for layer in ("weathering", "drawn"):
            here, there = (sampled(getattr(maps(name, key), layer), key, xy) for key in ((column, row), other))
            apart = np.abs(here - there)
            # Where nothing is painted, the wear and colour of paint mean nothing.
            if layer == "drawn":
                apart = apart[..., [0, 3]]
            assert np.quantile(apart, 0.99) < 10
            assert apart.mean() < 1.2


def test_same_seed_same_bytes_and_another_seed_another_road() -> None:
    key = key_at(*built("cross").world.segments[0].centre_line.coords[0])
    first, again = maps("cross", key), ground_maps(plan_ground(built("cross").world, 3), key)
    assert first.weathering.tobytes() == again.weathering.tobytes()
    assert first.drawn.tobytes() == again.drawn.tobytes()
    other = ground_maps(plan_ground(built("cross").world, 0), key)
    assert not np.array_equal(first.weathering, other.weathering)


@pytest.mark.parametrize("name", ["berlin_neukoelln", "seattle_roosevelt"])
def test_paint_keeps_to_the_carriageway(name: str) -> None:
    road = plan(name).road.buffer(0.1)
    shapely.prepare(road)
    count = 0
    for segment in built(name).world.segments[::4]:
        spot = segment.centre_line.interpolate(0.97, normalized=True)
        xy = painted(name, key_at(spot.x, spot.y))
        count += len(xy)
        assert shapely.intersects(road, shapely.points(xy)).mean() > 0.985 if len(xy) else True
    assert count > 1000


def test_a_line_parts_the_lanes_of_a_main_street() -> None:
    """On the cross's four-lane street, paint lies between lanes and none in the middle of them."""
    where = plan("cross")
    street = next(street for street in where.streets if street.main and max(len(way) for way in street.ways) > 1)
    lane = street.ways[0][0]
    stations = np.linspace(15.0, lane.length_m - 40.0, 400)
    for left, least, most in ((lane.width_m / 2, 0.2, 0.9), (0.75, 0.0, 0.02)):
        line = lane.centre_line.offset_curve(left)
        inside = [drawn_at("cross", *line.interpolate(station).coords[0]) > 128 for station in stations]
        share = float(np.mean(inside))
        assert least <= share <= most


def test_every_signalled_lane_ends_at_a_stop_line() -> None:
    where = plan("berlin_neukoelln")
    lanes = {path.approach.lane.id: path.approach for path in where.paths}
    signalled = [approach for approach in lanes.values() if approach.junction.kind == "traffic_light"]
    assert signalled
    for approach in signalled:
        line = approach.lane.centre_line
        near = line.interpolate(line.length - 1.0).buffer(14.0)
        key = key_at(near.centroid.x, near.centroid.y)
        bars = where.paint.bars[np.isclose(where.paint.bars[:, 4], where.standard.stop_m / 2)]
        hits = [
            bar for bar in bars if near.contains(shapely.Point(bar[:2])) and line.distance(shapely.Point(bar[:2])) < 0.2
        ]
        assert hits, (approach.lane.id, key)


def test_america_parts_directions_in_yellow_and_europe_in_white() -> None:
    american, german = (
        markings(plan(name), plan(name).standard).bar_paints[:, 0] for name in ("seattle_roosevelt", "berlin_neukoelln")
    )
    assert (american == paint("yellow")).sum() > 50
    assert (german == paint("white")).all()


def test_seals_keep_clear_of_defects() -> None:
    world = built("berlin_neukoelln").world
    free = plan("berlin_neukoelln").repairs
    holes = [shapely.LineString(line).interpolate(0.5, normalized=True).buffer(0.5) for line in free.seals[:20]]
    holes = [hole for index, hole in enumerate(holes) if all(hole.disjoint(other) for other in holes[:index])]
    kept = plan_ground(world, 3, holes).repairs
    lines = shapely.union_all([shapely.LineString(line) for line in kept.seals if not np.allclose(line[0], line[-1])])
    assert lines.distance(shapely.union_all(holes)) > 0.02
    assert lines.length > 10


def test_seals_run_on_over_cracks_that_they_cross() -> None:
    """A cut as narrow as a crack across a seal leaves it whole; the same cut along it interrupts it."""
    world = built("berlin_neukoelln").world
    long = max(plan("berlin_neukoelln").repairs.seals, key=lambda line: shapely.LineString(line).length)
    path = shapely.LineString(long)
    middle = path.interpolate(0.5, normalized=True)
    ahead = path.interpolate(path.length / 2 + 0.5)
    along = shapely.LineString([middle, ahead])
    across = shapely.affinity.rotate(along, 80.0, origin="centroid")
    lengths = []
    for crack in (across, along):
        seals = plan_ground(world, 3, [crack.buffer(0.05)]).repairs.seals
        mine = [line for line in seals if shapely.LineString(line).distance(path) < 0.01]
        lengths.append(max(shapely.LineString(line).length for line in mine))
    assert lengths[0] == pytest.approx(path.length)
    assert lengths[1] < 0.6 * path.length


def test_maps_use_their_range_and_no_more() -> None:
    for name in ("cross", "berlin_neukoelln"):
        spot = built(name).world.segments[0].centre_line.interpolate(0.5, normalized=True)
        tone = maps(name, key_at(spot.x, spot.y)).weathering[..., 0]
        assert np.quantile(tone, 0.02) > 0.5 * 128
        assert np.quantile(tone, 0.98) < 1.7 * 128
        assert tone.std() > 3


@pytest.mark.parametrize("kind", list(GroundKind))
def test_grain_repeats_without_a_seam(kind: GroundKind) -> None:
    detail = details()[kind]
    for layer in (detail.reflectance, detail.relief):
        values = layer.astype(np.float64)
        for axis in (0, 1):
            steps = np.abs(np.diff(values, axis=axis)).mean(axis=(1 - axis, 2))
            seam = np.abs(values.take(0, axis) - values.take(-1, axis)).mean()
            # Joints of slabs and stones are steps too: the seam is no greater than the greatest of them.
            assert seam <= steps.max() * 1.15 + 0.5


@pytest.mark.parametrize("kind", list(GroundKind))
def test_grain_reflects_as_much_as_its_kind_does(kind: GroundKind) -> None:
    low, high = MEANS[kind]
    mean = linear_of_srgb(details()[kind].reflectance[..., :3] / 255).mean()
    assert low < mean < high
    slope = (details()[kind].relief[..., :2].astype(float) - 128) / 127
    assert np.abs(slope.mean(axis=(0, 1))).max() < 0.01
    assert (slope**2).sum(axis=-1).max() < 1.0


def test_worn_concrete_shows_its_stones() -> None:
    """A twentieth of its texels is paler or darker than around them by an eighth, and some of both."""
    light = linear_of_srgb(details()[GroundKind.SLABS].reflectance[..., :3] / 255).mean(axis=-1).astype(np.float32)
    contrast = blurred(light, 1.2) / blurred(light, 12.0) - 1
    assert 0.03 < (np.abs(contrast) > 0.12).mean() < 0.12
    assert min((contrast > 0.12).mean(), (contrast < -0.12).mean()) > 0.005


def plain(paint: int, wear: int, bitumen: int = 1, which: int = 0) -> GroundMaps:
    """Maps of one value everywhere: no weathering."""
    weathering = np.zeros((MAP_PX, MAP_PX, 4), dtype=np.uint8)
    weathering[..., 0] = 128
    drawn = np.zeros((MAP_PX, MAP_PX, 4), dtype=np.uint8)
    drawn[...] = paint, which, wear, bitumen
    return GroundMaps(weathering, drawn)


@cache
def look(
    paint: int, wear: int, bitumen: int = 1, footprint_m: float = 0.005, which: int = 0, lost: float = 0.0
) -> np.ndarray:
    xy = np.random.default_rng(0).uniform(2.0, 30.0, (4000, 2))
    maps = plain(paint, wear, bitumen, which)
    return surface(GroundKind.ASPHALT, xy, xy, (0.0, 0.0), maps, footprint_m, lost=lost).albedo


def test_paint_covers_and_wear_takes_it_off_in_proportion() -> None:
    bare, fresh = look(1, 0).mean(), look(255, 0).mean()
    assert fresh == pytest.approx(np.mean(PAINTS["white"]), rel=0.03)
    assert look(255, 255).mean() == pytest.approx(bare, rel=0.02)
    for footprint_m in (0.002, 0.008, 0.03):
        half = look(255, 128, footprint_m=footprint_m).mean()
        clean = 1 - 0.35 * 128 / 255
        assert half == pytest.approx((fresh * clean + bare) / 2, rel=0.12)


def test_bitumen_is_darker_than_asphalt_and_hides_its_grain() -> None:
    assert look(1, 0, 255).mean() < 0.5 * look(1, 0).mean()
    assert look(1, 0, 255).std() < 0.3 * look(1, 0).std()


def test_paint_and_bitumen_are_lost_with_the_surface_below_and_plants_are_not() -> None:
    bare = look(1, 0)
    assert np.allclose(look(255, 0, lost=1.0), bare, atol=1e-6)
    assert np.allclose(look(1, 0, 255, lost=1.0), bare, atol=1e-6)
    assert look(255, 0, lost=0.5).mean() == pytest.approx((look(255, 0).mean() + bare.mean()) / 2, rel=1e-3)
    moss = round(255 * list(PAINTS).index("moss") / (len(PAINTS) - 1))
    assert np.array_equal(look(255, 0, which=moss, lost=1.0), look(255, 0, which=moss))
    assert not np.allclose(look(255, 0, which=moss), bare, atol=0.01)


def test_an_edge_of_paint_lies_where_its_distance_is_none() -> None:
    """A ramp of signed distance: half of the paint's light is reached at distance 0, to within its ragged edge."""
    drawn = plain(1, 0).drawn.copy()
    columns = (np.arange(MAP_PX) + 0.5) * TEXEL_M - MAP_MARGIN_M - 16.0
    drawn[..., 0] = np.clip(columns / SIGNED_DISTANCE_M * 127 + 128, 1, 255)[None, :]
    made = GroundMaps(plain(1, 0).weathering, drawn)
    x = np.linspace(15.9, 16.1, 81)
    xy = np.stack(np.meshgrid(x, np.linspace(3, 29, 300)), axis=-1)
    light = surface(GroundKind.ASPHALT, xy, xy, (0.0, 0.0), made, 0.003).albedo.mean(axis=(0, 2))
    middle = (light[0] + light[-1]) / 2
    assert x[int(np.argmax(light > middle))] == pytest.approx(16.0, abs=0.008)


def test_grain_fades_with_height() -> None:
    spread = [float(look(1, 0, footprint_m=footprint).std()) for footprint in (0.002, 0.008, 0.03)]
    assert spread[0] > 1.5 * spread[1] > 2.0 * spread[2]


def test_srgb_there_and_back() -> None:
    values = np.linspace(0, 1, 257)
    assert srgb_of_linear(linear_of_srgb(values)) == pytest.approx(values, abs=1e-5)


def test_a_tile_without_roads_is_unmarked() -> None:
    far = ground_maps(plan("cross"), (400, -300))
    assert (far.drawn[..., 0] == 1).all()
    assert (far.drawn[..., 3] == 1).all()
    assert tile_box((400, -300)).disjoint(plan("cross").road)


def along_seals(name: str, key: tuple[int, int]) -> list[np.ndarray]:
    """Of every long line on a tile that is sealed, not open, the coded distance to bitumen along it, every 5 cm."""
    where, found = plan(name), []
    for line, half_m in zip(where.repairs.seals, where.repairs.seal_halves_m, strict=True):
        if half_m < SEAM_HALF_M[0]:
            continue
        path = shapely.LineString(line).intersection(tile_box(key))
        if isinstance(path, shapely.LineString) and path.length > 5.0:
            xy = shapely.get_coordinates(path.interpolate(np.arange(0.0, path.length, 0.05)))
            found.append(sampled(maps(name, key).drawn, key, xy)[:, 3])
    return found


def test_seals_run_on_for_metres_vary_in_width_and_end_thin() -> None:
    name = "berlin_neukoelln"
    where = plan(name)
    long = max(where.repairs.seals, key=lambda line: shapely.LineString(line).length)
    keys = {key_at(x, y) for x, y in long[:: max(1, len(long) // 12)]}
    runs = [values for key in sorted(keys) for values in along_seals(name, key)]
    assert len(runs) > 2
    assert np.mean(np.concatenate(runs) > 128) > 0.6
    assert np.mean([values.std() for values in runs]) > 2.0
    wide, narrow = [], []
    for line in where.repairs.seals:
        if not np.allclose(line[0], line[-1]) and shapely.LineString(line).length > 2.0 and len(wide) < 12:
            for share, of in ((0.02, narrow), (0.5, wide)):
                spot = np.array(shapely.LineString(line).interpolate(share * 2.0).coords)
                key = key_at(*spot[0])
                of.append(float(sampled(maps(name, key).drawn, key, spot)[0, 3]))
    assert np.mean(narrow) < np.mean(wide) - 5


def test_paint_wears_most_where_wheels_run() -> None:
    """On stripes of a crossing the map's wear follows the map's polish, which is where wheels pass."""
    where = plan("berlin_neukoelln")
    stripes = where.paint.bars[np.isclose(where.paint.bars[:, 4] * 2, where.standard.stripe_m[0])]
    polish, wear = [], []
    for key in sorted({key_at(x, y) for x, y in stripes[:, :2]})[:4]:
        found = maps("berlin_neukoelln", key)
        inside = found.drawn[..., 0] > 140
        polish.append(found.weathering[inside][:, 3])
        wear.append(found.drawn[inside][:, 2])
    passed, lost = np.concatenate(polish), np.concatenate(wear)
    assert lost[passed > 120].mean() > 1.5 * lost[passed < 40].mean()


def test_worn_paint_is_the_same_share_from_near_and_from_afar() -> None:
    """Grains that melt into one pixel leave its mean as it was, and no grain stands out any more."""
    for wear in (40, 90, 150):
        near, far = look(255, wear, footprint_m=0.002), look(255, wear, footprint_m=0.02)
        assert far.mean() == pytest.approx(near.mean(), rel=0.09)
        assert far.std() < 0.5 * near.std()


def test_edge_lines_keep_off_grates() -> None:
    for name in ("berlin_neukoelln", "cross"):
        where = plan(name)
        lines = where.paint.bars[np.isclose(where.paint.bars[:, 4] * 2, where.standard.line_m)]
        grates = np.array([(thing.x, thing.y) for thing in where.fixtures if thing.model == "grate"])
        kerb = shapely.distance(where.road.boundary, shapely.points(grates))
        assert kerb.max() < 0.2, "a grate lies at the kerb"
        cos, sin = np.cos(lines[:, 2]), np.sin(lines[:, 2])
        for x, y in grates:
            dx, dy = x - lines[:, 0], y - lines[:, 1]
            beside = np.abs(cos * dx + sin * dy) < lines[:, 3]
            along_kerb = np.abs(cos * dy - sin * dx) < 0.15 + lines[:, 4]
            assert not (beside & along_kerb).any()

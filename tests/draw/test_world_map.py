"""`pavetwin world show` and `navmesh` as a user types them, and what their files hold."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from PIL import Image
from shapely import affinity

from pavetwin.arrays import UInt8Array
from pavetwin.cli import main
from pavetwin.draw import lettering, style
from pavetwin.draw.extent import lane_lines
from pavetwin.draw.shapes import shadow, stripes
from pavetwin.draw.style import with_palette
from pavetwin.draw.world_map import ABOVE_WORLD, draw_world
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import World
from pavetwin.world.store import attribution, load_world, save_world
from scenes import damaged


def run(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    """Run one command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["pavetwin", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worlds") / "cross"
    save_world(damaged("cross", 4), folder)
    return folder


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = tmp_path_factory.mktemp("worlds") / "town"
    return save_world(damaged("town", 4), folder)


def test_show_states_where_the_map_is(
    cross: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "world", "show", cross) == 0
    assert str(cross / "map.png") in capsys.readouterr().out
    with Image.open(cross / "map.png") as image:
        assert max(image.size) > 1200
    (cross / "map.png").unlink()


def test_the_same_world_gives_the_same_bytes(cross: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        assert run(monkeypatch, "world", "show", cross, "--ids", "--html", "-o", tmp_path / f"{name}.png") == 0
        assert run(monkeypatch, "world", "show", cross, "-o", tmp_path / f"{name}.svg") == 0
        assert run(monkeypatch, "world", "show", cross, "-o", tmp_path / f"{name}.pdf") == 0
    for kind in ("png", "html", "svg", "pdf"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes(), kind


@pytest.mark.slow
def test_a_town_fits_in_half_a_megabyte_and_has_room_for_all_ids(
    town: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert town.folder is not None
    assert run(monkeypatch, "world", "show", town.folder, "--ids", "--html", "-o", tmp_path / "t.png") == 0
    assert (tmp_path / "t.png").stat().st_size < 500_000
    assert (tmp_path / "t.html").stat().st_size < 1_500_000
    assert "no room" not in capsys.readouterr().out


def test_the_page_loads_nothing_and_lists_every_segment_and_defect(
    cross: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "world", "show", cross, "--html", "-o", tmp_path / "m.png") == 0
    page = (tmp_path / "m.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|<link|<iframe|<img|@import|\bsrc=|url\(|%%", page)
    world = load_world(cross)
    assert all(f"data-tip='{segment.label}&#10;" in page for segment in world.segments)
    assert "unnamed street, s0" in page
    assert page.count("data-d='") == len(world.defects)
    assert "© OpenStreetMap contributors" in page


def test_names_from_a_map_stay_text(cross: Path) -> None:
    from pavetwin.draw.world_html import world_page

    world = load_world(cross)
    hostile = replace(world.segments[0], street="<script>alert('x')</script>")
    page = world_page(replace(world, segments=(hostile, *world.segments[1:])))
    assert page.count("<script>") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["show", "nowhere"], "does not exist"),
        (["show", "WORLD", "-o", "map.bmp"], ".png, .svg or .pdf"),
        (["show", "WORLD", "-o", "/proc/nothing/map.png"], "Cannot write"),
        (["show", "WORLD", "--html", "-o", "/proc/nothing/map.png"], "Cannot write"),
        (["navmesh", "WORLD", "--altitude", "0"], "--altitude 0: the UAV flies at 5 m or higher"),
        (["navmesh", "WORLD", "--altitude", "-6"], "--altitude -6"),
        (["navmesh", "WORLD", "--altitude", "nan"], "--altitude nan"),
        (["navmesh", "WORLD", "--altitude", "inf"], "--altitude inf"),
        (["navmesh", "WORLD", "-o", "/proc/nothing/map.png"], "Cannot write"),
        (["navmesh", "WORLD", "--geopackage", "mesh.shp"], ".gpkg"),
        (["navmesh", "nowhere"], "does not exist"),
    ],
)
def test_mistakes_are_one_plain_line_and_leave_nothing(
    words: list[str],
    message: str,
    cross: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(cross.rglob("*"))
    assert run(monkeypatch, "world", *(str(cross) if word == "WORLD" else word for word in words)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("Error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert list(tmp_path.iterdir()) == []
    assert sorted(cross.rglob("*")) == before


def test_navmesh_is_drawn_counted_and_saved(
    cross: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target, layer = tmp_path / "mesh.png", tmp_path / "mesh.gpkg"
    assert run(monkeypatch, "world", "navmesh", cross, "--altitude", "6", "-o", target, "--geopackage", layer) == 0
    said = capsys.readouterr().out
    world = load_world(cross)
    meta, _, geometry, (numbers,) = pyogrio.raw.read(layer, layer="navmesh")
    shapes = shapely.from_wkb(geometry)
    assert meta["fields"].tolist() == ["polygon"]
    assert numbers.tolist() == list(range(len(shapes)))
    assert f"{len(shapes)} convex" in said
    assert f"{shapely.area(shapes).sum():.0f} m²" in said
    assert f"{len(world.segments)} of {len(world.segments)} segments (100%)" in said
    assert " s " in said
    assert meta["crs"] == f"EPSG:{world.georeference.epsg}"
    assert shapely.area(shapely.convex_hull(shapes)) == pytest.approx(shapely.area(shapes), rel=1e-6, abs=1e-3)
    first = target.read_bytes()
    assert run(monkeypatch, "world", "navmesh", cross, "--altitude", "6", "-o", target) == 0
    assert target.read_bytes() == first


@pytest.mark.slow
def test_everything_lies_below_what_is_drawn_on_top(town: World) -> None:
    with style.styled():
        axes = style.new_figure(5, 5).add_subplot()
        draw_world(axes, town, ids=True)
    assert max(artist.get_zorder() for artist in [*axes.collections, *axes.lines, *axes.texts]) < ABOVE_WORLD


def test_letters_do_not_overlap(town: World) -> None:
    with style.styled():
        axes = style.new_figure(9, 9).add_subplot()
        draw_world(axes, town, layers=())
        room = lettering.OccupiedSpace()
        lettering.segment_ids(axes, town.segments, room)
        lettering.write_street_names(axes, town, town.segments, room)
    taken = room.taken
    assert len(taken) > len(town.segments)
    assert not any(taken[a].intersects(taken[b]) for a in range(len(taken)) for b in range(a))


@pytest.mark.parametrize("name", ["A", "B ", "Ü", "IJ"])
def test_a_street_may_have_the_shortest_of_names(town: World, name: str) -> None:
    renamed = replace(town, segments=tuple(replace(segment, street=name) for segment in town.segments))
    with style.styled():
        axes = style.new_figure(9, 9).add_subplot()
        draw_world(axes, town, layers=())
        room = lettering.OccupiedSpace()
        lettering.write_street_names(axes, renamed, renamed.segments, room)
    assert room.taken


def test_the_carriageway_holds_its_segments_and_no_houses(town: World) -> None:
    roads = town.carriageway
    segments = shapely.union_all([segment.polygon for segment in town.segments])
    assert segments.difference(roads.buffer(0.02)).area < 1.0
    assert shapely.area(shapely.intersection([house.polygon for house in town.buildings], roads)).sum() < 1.0
    assert all(roads.contains(shapely.LineString(line)) for line in lane_lines(town))


def test_a_shadow_is_its_base_swept() -> None:
    court = shapely.box(0, 0, 10, 10).difference(shapely.box(2, 2, 8, 8))
    cast = shadow([court], np.array([10.0]), 0.3, 0.4, 5.0)
    sides = [shapely.Polygon(ring) for ring in cast.to_polygons()]
    assert all(side.exterior.is_ccw for side in sides if side.area > 0)
    steps = [affinity.translate(court, 0.3 * metres, -0.4 * metres) for metres in np.linspace(0, 10, 201)]
    swept = shapely.union_all([court, *shapely.buffer(sides, 0)])
    assert swept.symmetric_difference(shapely.union_all(steps)).area < 0.6
    assert swept.bounds == pytest.approx((0, -4, 13, 10))
    assert shadow([court], np.array([90.0]), 0.3, 0.4, 5.0).get_extents().x1 == pytest.approx(13)
    assert len(shadow([], np.array([]), 0.3, 0.4, 5.0).vertices) == 0


def test_a_zebra_lies_across_its_longer_side() -> None:
    bars = stripes(shapely.box(0, 0, 6, 3), 0.5, 0.5)
    assert len(bars) == 5
    assert all(abs(bar[0, 0] - bar[1, 0]) < 1e-9 for bar in bars)


def test_a_user_style_is_left_aside_and_comes_back(cross: Path, tmp_path: Path) -> None:
    import matplotlib

    from pavetwin.draw.world_map import save_world_map

    world = load_world(cross)
    save_world_map(world, tmp_path / "a.png")
    with matplotlib.rc_context({"font.size": 30, "figure.facecolor": "red", "savefig.dpi": 20}):
        save_world_map(world, tmp_path / "b.png")
        assert matplotlib.rcParams["font.size"] == 30
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_attribution_is_stated_and_scales_are_round() -> None:
    assert attribution("berlin.osm.pbf") == "© OpenStreetMap contributors"
    assert attribution("generated town") is None
    assert [style.nice_length_m(length) for length in (0.7, 1, 9, 123, 999)] == [0.5, 1, 5, 100, 500]
    with pytest.raises(PaveTwinError, match="png"):
        style.save_figure(style.new_figure(1, 1), Path("x.gif"))


def opaque(rgb: UInt8Array) -> UInt8Array:
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), 255, np.uint8)], axis=-1)


def test_a_palette_keeps_large_areas_and_rare_colours() -> None:
    red, green = np.meshgrid(np.arange(256), np.arange(256))
    pixels = np.stack([red, green, 255 - red], axis=-1).astype(np.uint8)  # 65,536 colours, as edges make many
    pixels[:128] = (244, 241, 235)
    pixels[200, 7:9] = (0, 132, 0)  # a mark of two pixels, unlike all others
    drawn = with_palette(opaque(pixels))
    assert drawn.mode == "P"
    shown = np.asarray(drawn.convert("RGB")).astype(int)
    away = np.abs(shown - pixels).max(axis=-1)
    assert away[:128].max() <= 1
    assert away[200, 7:9].max() <= 16
    assert away.max() <= 16
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) <= 256


def test_few_colours_stay_as_they_are() -> None:
    pixels = np.zeros((4, 5, 3), dtype=np.uint8)
    pixels[1:3] = (255, 255, 255)
    pixels[0, 0] = (31, 58, 95)
    assert np.array_equal(np.asarray(with_palette(opaque(pixels)).convert("RGB")), pixels)


def test_a_figure_has_the_pixels_that_matplotlib_saves(tmp_path: Path) -> None:
    with style.styled():
        figure = style.new_figure(2.0, 1.0)
        axes = style.axes_in(figure, 0.2, 0.2, 1.6, 0.7)
        axes.plot([0, 1], [0, 1], color="#1F3A5F", alpha=0.5)
        figure.savefig(tmp_path / "whole.png", format="png", dpi=style.DPI)
    with Image.open(tmp_path / "whole.png") as saved:
        expected = np.asarray(with_palette(np.asarray(saved.convert("RGBA"))).convert("RGB"))
    style.save_figure(figure, tmp_path / "figure.png")
    with Image.open(tmp_path / "figure.png") as saved:
        assert np.array_equal(np.asarray(saved.convert("RGB")), expected)

"""Names in any script are readable on images: by a font that has their letters, or in Latin letters or as an id."""

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib.font_manager import fontManager
from PIL import Image, ImageDraw

from pavetwin.draw import fonts, lettering, style
from pavetwin.draw.fonts import remark, shown_label, shown_names
from pavetwin.draw.mission_style import write
from pavetwin.draw.world_html import world_page
from pavetwin.draw.world_map import save_world_map, world_bounds
from scenes import scripts

Machine = Callable[[Sequence[Path]], None]


def made_up_font(path: Path, letters: str, family: str = "Made-up Sans") -> Path:
    """A font that writes each of some letters as a black square."""
    pen = TTGlyphPen(None)
    pen.moveTo((100, 0))
    for corner in ((100, 800), (900, 800), (900, 0)):
        pen.lineTo(corner)
    pen.closePath()
    square, names = pen.glyph(), [f"u{ord(letter):04x}" for letter in letters]
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder([".notdef", *names])
    builder.setupCharacterMap({ord(letter): name for letter, name in zip(letters, names, strict=True)})
    builder.setupGlyf(dict.fromkeys([".notdef", *names], square))
    builder.setupHorizontalMetrics(dict.fromkeys([".notdef", *names], (1000, 100)))
    builder.setupHorizontalHeader(ascent=900, descent=-100)
    builder.setupNameTable({"familyName": family, "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(path)
    return path


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    """Makes the machine have just some fonts besides Matplotlib's."""
    caches, known = (fonts.fonts, style.text_width_pt, lettering._outline), list(fontManager.ttflist)

    def have(paths: Sequence[Path]) -> None:
        monkeypatch.setattr(fonts, "findSystemFonts", lambda: [str(path) for path in paths])
        for each in caches:
            each.cache_clear()

    yield have
    fontManager.ttflist[:] = known
    for each in caches:
        each.cache_clear()


def letters_of(script: str) -> str:
    names = {segment.street for segment in scripts.built(script).world.segments if segment.has_street_name}
    return "".join(sorted({letter for letter in "".join(names) if letter.isprintable() and letter != " "}))


def drawn_without_a_warning(script: str, folder: Path) -> None:
    world = scripts.built(script).world
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_world_map(world, folder / "map.png", ids=True)


@pytest.mark.parametrize(
    ("script", "package"),
    [("chinese", "fonts-noto-cjk"), ("arabic", None), ("cyrillic", None), ("devanagari", "fonts-noto-core")],
)
def test_without_a_font_names_are_latin_or_ids(
    script: str, package: str | None, machine: Machine, tmp_path: Path
) -> None:
    machine([])
    world, town = scripts.built(script).world, scripts.TOWNS[script]
    drawn_without_a_warning(script, tmp_path)
    said = remark(world)
    for segment in world.segments:
        shown = shown_names(world)[segment.id]
        tags = next((tags for tags in town.streets if tags["name"] == segment.street), None)
        if tags is None:
            assert shown == shown_label(world, segment) == f"unnamed street, {segment.id}"
        elif package is None:  # DejaVu Sans has the letters
            assert shown == segment.street
        else:
            latin = next((name for key, name in tags.items() if key != "name"), None)
            assert shown == (latin or segment.id)
            assert shown_label(world, segment) == (f"{latin}, {segment.id}" if latin else segment.id)
    if package is None:
        assert said is None
    else:
        assert said is not None
        assert said.startswith("No font on this machine has the letters of the names of 4 streets")
        assert said.endswith(f"apt-get install {package}")


@pytest.mark.parametrize("script", ["chinese", "devanagari"])
def test_with_a_font_names_are_as_on_the_map(script: str, machine: Machine, tmp_path: Path) -> None:
    made_up = made_up_font(tmp_path / "made-up.ttf", letters_of(script))
    machine([made_up_font(tmp_path / "other.ttf", letters_of(script)[:3], "Other Sans"), made_up])
    world = scripts.built(script).world
    drawn_without_a_warning(script, tmp_path)
    assert shown_names(world) == {segment.id: segment.street_name for segment in world.segments}
    assert all(shown_label(world, segment) == segment.label for segment in world.segments)
    assert remark(world) is None
    assert fonts.families(letters_of(script)) == ["DejaVu Sans", "Made-up Sans"]
    left, bottom, right, top = lettering._outline(next(filter(str.isalpha, letters_of(script)))).get_extents().extents
    assert [left, bottom, right, top] == pytest.approx([0.1, 0.0, 0.9, 0.8], abs=0.02)


def test_a_font_that_cannot_be_read_is_passed_over(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "damaged.ttf").write_bytes(b"no font")
    machine([tmp_path / "damaged.ttf", made_up_font(tmp_path / "made-up.ttf", "青")])
    assert fonts.readable("青")
    assert not fonts.readable("青石")


def test_latin_text_needs_no_font_of_the_machine(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    machine([])
    monkeypatch.setattr(fonts.Fonts, "_best", None)  # a search for one would fail
    assert fonts.families("Häuserstraße, s0002 · 4 × τ") == ["DejaVu Sans"]


def test_every_text_of_a_figure_gets_its_font(machine: Machine, tmp_path: Path) -> None:
    machine([made_up_font(tmp_path / "made-up.ttf", "青")])
    with style.styled(), warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = style.new_figure(3, 3)
        axes = figure.add_subplot(title="青石青")
        axes.set_yticks([0, 1], labels=["青", "plain"])
        axes.plot([0, 1], label="石")
        axes.legend()
        style.save_figure(figure, tmp_path / "plot.svg")
    assert axes.get_title(loc="left") or axes.get_title() == "青…青"
    assert axes.get_yticklabels()[0].get_fontfamily() == ["DejaVu Sans", "Made-up Sans"]
    assert axes.get_yticklabels()[1].get_fontfamily() == ["DejaVu Sans"]


def test_pillow_writes_each_part_in_a_font_that_has_it(machine: Machine, tmp_path: Path) -> None:
    machine([made_up_font(tmp_path / "made-up.ttf", "青石")])
    assert [run for run, _ in fonts.runs("青 石, s0001")] == ["青 石", ", s0001"]
    picture = Image.new("L", (400, 40), 255)
    end = write(ImageDraw.Draw(picture), (0, 0), "青青", 20, fill=0)
    assert end == pytest.approx(40, abs=1)
    assert picture.getpixel((10, 10)) == picture.getpixel((30, 10)) == 0


def test_where_pillow_cannot_join_letters_the_name_is_latin(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    machine([])
    world = scripts.built("arabic").world
    segment = next(segment for segment in world.segments if segment.street == "شارع النخيل")
    monkeypatch.setattr(fonts.features, "check", {"raqm"}.__contains__)
    assert shown_label(world, segment, by_pillow=True) == segment.label
    monkeypatch.setattr(fonts.features, "check", set[str]().__contains__)
    assert shown_label(world, segment, by_pillow=True) == f"Palm Street, {segment.id}"


@pytest.mark.parametrize(
    ("name", "pieces"),
    [
        ("Bell", ["B", "e", "l", "l"]),
        ("青石", ["青", "石"]),
        ("शांति पथ", ["शांति", " ", "पथ"]),
        ("شارع النخيل", ["النخيل", " ", "شارع"]),
    ],
)
def test_letters_that_join_are_placed_as_words_in_their_direction(name: str, pieces: list[str]) -> None:
    assert lettering._pieces(name) == pieces


def test_a_page_holds_names_as_they_are(machine: Machine) -> None:
    """The browser has fonts of its own; where it has none, a segment's tip shows the Latin name."""
    machine([])
    page = world_page(scripts.built("chinese").world)
    assert "青石路</textPath>" in page
    assert re.search(r"data-tip='青石路, s\d+ \(Bluestone Road\)&#10;", page)
    assert re.search(r"data-tip='無英名巷, s\d+&#10;", page)
    assert "unnamed street, s0001" in page


def test_a_text_that_begins_with_an_arabic_name_still_runs_from_the_left(machine: Machine) -> None:
    machine([])
    with style.styled():
        figure = style.new_figure(3, 1)
        texts = [
            figure.text(0.0, 0.5, words) for words in ("زقاق الورد, s0004", "West: زقاق الورد", "Häuserstraße, s0004")
        ]
        for _ in range(2):
            fonts.choose_fonts(figure)
    assert [text.get_text() for text in texts] == [
        "\N{LEFT-TO-RIGHT MARK}زقاق الورد, s0004",
        "West: زقاق الورد",
        "Häuserstraße, s0004",
    ]


def test_ids_leave_room_for_the_names_of_streets(machine: Machine) -> None:
    machine([])
    world = scripts.built("chinese").world
    with style.styled():
        axes = style.map_figure(world_bounds(world), title="", subtitle="", legend=[], credit=None).axes
        style.frame_axes(axes, world_bounds(world))
        occupied = lettering.OccupiedSpace()
        assert lettering.segment_ids(axes, world.segments, occupied) == []
        assert lettering.write_street_names(axes, world, world.segments, occupied) == []

"""Fonts by the letters of a text, and street names in letters that a font has."""

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import matplotlib
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findSystemFonts, fontManager
from matplotlib.ft2font import FT2Font
from matplotlib.text import Text
from PIL import features

from pavetwin.world.model import Segment, World

USUAL: Final = "DejaVu Sans"
USUAL_FILES: Final = {bold: f"DejaVuSans{'-Bold' * bold}.ttf" for bold in (False, True)}

_EAST_ASIAN = ("CJK", "HIRAGANA", "KATAKANA", "HANGUL", "BOPOMOFO", "IDEOGRAPHIC")
_LEFTWARDS = ("R", "AL")
_LEFT_TO_RIGHT: Final = "\N{LEFT-TO-RIGHT MARK}"
_STYLES: Final = ("Regular", "Bold")


@dataclass(frozen=True)
class FontFace:
    """A font of the machine."""

    path: str
    family: str
    letters: frozenset[int]  # Code points

    def __contains__(self, letter: str) -> bool:
        return ord(letter) in self.letters


class Fonts:
    """The fonts of a machine; one is read when a text first needs it."""

    def __init__(self, paths: Iterable[str]) -> None:
        self._paths = sorted(paths)
        self._usual = FontFace(usual_file(), USUAL, frozenset(FT2Font(usual_file()).get_charmap()))
        self._chosen = [self._usual]
        self._nowhere = set[str]()

    def faces(self, text: str) -> list[FontFace]:
        """The fonts that write a text together, DejaVu Sans first."""
        lacking = self._lacking(text, self._chosen) - self._nowhere
        while lacking and (face := self._best(lacking)) is not None:
            self._chosen.append(face)
            lacking = self._lacking("".join(lacking), [face])
        self._nowhere |= lacking
        needed, rest = [self._usual], self._lacking(text, [self._usual])
        for face in self._chosen[1:]:
            if (left := self._lacking("".join(rest), [face])) < rest:
                needed.append(face)
                rest = left
        return needed

    def lacking(self, text: str) -> set[str]:
        """The letters of a text that no font writes."""
        return self._lacking(text, self.faces(text))

    @staticmethod
    def _lacking(text: str, faces: Sequence[FontFace]) -> set[str]:
        return {letter for letter in set(text) if not any(letter in face for face in faces) and not _is_blank(letter)}

    def _best(self, letters: set[str]) -> FontFace | None:
        """The font with the most of some letters, an upright one without serifs before others."""
        best, found, rank = None, "", (0, False, False)
        for path, font in self._opened():
            count = sum(font.get_char_index(ord(letter)) > 0 for letter in letters)
            own = (count, "sans" in font.family_name.lower(), font.style_name == _STYLES[0])
            if count and own > rank:
                best, found, rank = font, path, own
        if best is None:
            return None
        self._register(best.family_name)
        return FontFace(found, best.family_name, frozenset(best.get_charmap()))

    def _register(self, family: str) -> None:
        """Register a family with Matplotlib, whose list may be older than the fonts."""
        known = {entry.fname for entry in fontManager.ttflist}
        for path, font in self._opened():
            if path not in known and font.family_name == family and font.style_name in _STYLES:
                fontManager.addfont(path)

    def _opened(self) -> Iterator[tuple[str, FT2Font]]:
        for path in self._paths:
            with suppress(OSError, RuntimeError):  # what is damaged, or no font
                yield path, FT2Font(path)


def _is_blank(letter: str) -> bool:
    """Whether nothing is drawn for a letter."""
    return unicodedata.category(letter) in ("Cc", "Cf", "Zs")


def usual_file(*, bold: bool = False) -> str:
    """The path of DejaVu Sans."""
    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / USUAL_FILES[bold])


@cache
def fonts() -> Fonts:
    """Fonts of this machine."""
    return Fonts(findSystemFonts())


def readable(text: str) -> bool:
    """Whether there is a font for every letter of a text."""
    return not fonts().lacking(text)


def families(text: str) -> list[str]:
    """The names of the fonts that write a text, for Matplotlib."""
    return [face.family for face in fonts().faces(text)]


def font_properties(text: str, *, bold: bool = False, size: float | None = None) -> FontProperties:
    return FontProperties(family=families(text), weight="bold" if bold else "normal", size=size)


def runs(text: str, *, bold: bool = False) -> list[tuple[str, str]]:
    """A text in parts, each with the file of a font that writes all of it, for Pillow."""
    faces, found = fonts().faces(text), list[tuple[str, str]]()
    for letter in text:
        before = found[-1][1] if found else usual_file(bold=bold)
        writes = (usual_file(bold=bold) if face.family == USUAL else face.path for face in faces if letter in face)
        file = before if _is_blank(letter) else next(writes, before)
        if found and file == before:
            found[-1] = (found[-1][0] + letter, file)
        else:
            found.append((letter, file))
    return found


def pillow_can_write(text: str) -> bool:
    """Whether Pillow can write a text on this machine: there are fonts, and what joins letters if they join."""
    return readable(text) and (not joins(text) or bool(features.check("raqm")))


def joins(text: str) -> bool:
    """Whether letters of a text join, stack or run to the left, so that it cannot be written letter by letter."""
    return any(
        unicodedata.category(letter).startswith("M") or unicodedata.bidirectional(letter) in _LEFTWARDS
        for letter in unicodedata.normalize("NFC", text)
    )


def runs_left(text: str) -> bool:
    """Whether a text runs from the right to the left."""
    strong = [kind for kind in map(unicodedata.bidirectional, text) if kind in ("L", *_LEFTWARDS)]
    return bool(strong) and strong[0] in _LEFTWARDS


def package_for(letters: Iterable[str]) -> str:
    """The Debian package that has fonts for letters."""
    names = [unicodedata.name(letter, "") for letter in letters]
    east_asian = [name.startswith(_EAST_ASIAN) for name in names]
    return " ".join(["fonts-noto-cjk"] * any(east_asian) + ["fonts-noto-core"] * (not all(east_asian)))


def choose_fonts(figure: Figure) -> None:
    """Give every text of a figure the fonts that it needs; letters without any become an ellipsis.

    Every text runs from the left as a whole, also one that begins with an Arabic or Hebrew name.
    """
    for axes in figure.get_axes():
        axes.xaxis.get_ticklabels()  # makes Matplotlib write them
        axes.yaxis.get_ticklabels()
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        words = text.get_text()
        if words.isascii():
            continue
        if lacking := fonts().lacking(words):
            words = re.sub(f"[{re.escape(''.join(sorted(lacking)))}]+", "…", words)
        text.set_text(_LEFT_TO_RIGHT + words if runs_left(words) else words)
        if len(needed := families(words)) > 1:
            text.set_fontfamily(needed)


def shown_names(world: World) -> dict[str, str]:
    """Street name of each segment, by id, in letters that an image can show; otherwise the id."""
    lacking = fonts().lacking("".join({segment.street for segment in world.segments}))
    shown = {}
    for segment in world.segments:
        names = (segment.street_name, world.latin_name_of(segment))
        shown[segment.id] = next((name for name in names if lacking.isdisjoint(name) and readable(name)), segment.id)
    return shown


def shown_label(world: World, segment: Segment, *, by_pillow: bool = False) -> str:
    """`Segment.label` in letters that Matplotlib and Pillow can draw."""
    labels = (segment.label, f"{world.latin_name_of(segment)}, {segment.id}")
    can_show = pillow_can_write if by_pillow else readable
    return next((label for label in labels if can_show(label)), segment.id)


def remark(world: World) -> str | None:
    """Message for the user where no font of the machine has the letters of some streets' names."""
    names = sorted({segment.street for segment in world.segments if segment.has_street_name})
    lacking = fonts().lacking("".join(names))
    if not lacking:
        return None
    count = sum(not lacking.isdisjoint(name) for name in names)
    streets = "one street's name" if count == 1 else f"the names of {count} streets"
    return (
        f"No font on this machine has the letters of {streets}; images show Latin names or segment ids instead. "
        f"Install one, on Debian: apt-get install {package_for(lacking)}"
    )

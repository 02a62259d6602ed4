"""OpenStreetMap files: their objects, numbers from free-text tags, names in Latin letters, and heights of buildings."""

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pavetwin.errors import PaveTwinError


def osm_objects(
    source: Path, *, only_ways: bool = False, areas: bool = False, keys: Sequence[str] = ()
) -> Iterator[Any]:
    """The objects of an OSM file in file order; with the areas made of ways and relations, and only those that have
    one of `keys` as a tag, when asked.

    Raises:
        PaveTwinError: the file cannot be read to its end.
    """
    import osmium

    filters = [osmium.filter.KeyFilter(*keys)] if keys else []
    try:
        processor = osmium.FileProcessor(str(source), osmium.osm.WAY if only_ways else osmium.osm.ALL)
        if areas:
            processor = processor.with_areas(*filters)
        for each in filters:
            processor = processor.with_filter(each)
        yield from processor
    except (RuntimeError, OSError, EOFError) as error:
        suffix = suffix_of_content(source)
        if not source.name.lower().endswith(suffix):
            raise PaveTwinError(
                f"'{source}' is {suffix} by its content; rename it so that it ends in {suffix}."
            ) from error
        raise PaveTwinError(
            f"'{source}' cannot be read as OpenStreetMap data ({error}); it may be cut short: download it again."
        ) from error


def suffix_of_content(source: Path) -> str:
    """Suffix for an OSM file of this content; empty where it is not an OSM file."""
    try:
        with source.open("rb") as file:
            head = file.read(64)
    except OSError:
        return ""
    if b"OSMHeader" in head[:24]:  # the type of the first blob, see the PBF format's description
        return ".osm.pbf"
    if head.startswith(b"\x1f\x8b"):
        return ".osm.gz"
    return ".osm" if head.lstrip(b"\xef\xbb\xbf \r\n").startswith((b"<?xml", b"<osm")) else ""


FOOT_M = 0.3048
LEVEL_HEIGHT_M = 3.0
"""Height of one storey [m]."""

ROOF_HEIGHT_M = 1.5
"""Added to `building:levels` for a roof whose height and levels are not mapped [m]."""

LOW_KINDS = frozenset(
    {"garage", "garages", "shed", "hut", "carport", "cabin", "kiosk", "toilets", "greenhouse", "roof", "service"}
)
"""Values of `building` that are one low storey."""

AREA_RULE = ((60.0, 3.0), (150.0, 6.5), (400.0, 9.5), (1500.0, 12.5))
"""Footprint up to [m²] → height [m] of a building without height tags; larger ones are 15 m."""

LARGEST_AREA_HEIGHT_M = 15.0

LATIN_NAMES = ("int_name", "name:en", "name:latin", r"name:\w+[-_](Latn.*|rm|pinyin)", "official_name:en", "alt_name")
"""Keys, as regular expressions, that may hold a name in Latin letters; the first that does counts."""

_LENGTH = re.compile(
    r"""^\s*[~≈<>]?\s*(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>[a-zA-Z'′’]*)\s*(?:(?P<inch>\d+)\s*["″”])?"""
)


def metres(text: str | None) -> float | None:
    """A length [m] from `12`, `10 m`, `10,5`, `40 ft`, `12'`, `12'6"`, `3;4` (the largest); None when it is none."""
    found = [length for part in re.split(r"[;/]", text or "") if (length := _metres(part)) is not None]
    return max(found, default=None)


def _metres(text: str) -> float | None:
    match = _LENGTH.match(text)
    if match is None:
        return None
    number = float(match["number"].replace(",", "."))
    unit = match["unit"].lower()
    if unit in ("'", "′", "’", "ft", "feet", "foot"):
        return number * FOOT_M + float(match["inch"] or 0) * FOOT_M / 12
    scale = {"": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "cm": 0.01}.get(unit)
    return None if scale is None else number * scale


def latin_name(tags: Mapping[str, str]) -> str:
    """The name in Latin letters of what has a name in another script; empty where it has none or needs none."""
    if not tags.get("name") or is_latin(tags["name"]):
        return ""
    named = (tags[key] for form in LATIN_NAMES for key in sorted(tags) if re.fullmatch(form, key))
    return next((name for name in named if is_latin(name)), "")


def is_latin(text: str) -> bool:
    """Whether all letters of a text, and at least one, are Latin."""
    letters = [letter for letter in text if letter.isalpha()]
    return bool(letters) and all("LATIN" in unicodedata.name(letter, "") for letter in letters)


def building_height_m(tags: Mapping[str, str], area_m2: float) -> float:
    """`height`; else levels × 3.0 m and the roof; else by kind and footprint. Between 2 and 400 m."""
    height = metres(tags.get("height")) or metres(tags.get("building:height"))
    levels = metres(tags.get("building:levels"))
    if height is None and levels:
        roof = metres(tags.get("roof:height"))
        if roof is None:
            roof_levels = metres(tags.get("roof:levels"))
            flat = tags.get("roof:shape") == "flat"
            roof = 0.0 if flat else roof_levels * LEVEL_HEIGHT_M if roof_levels is not None else ROOF_HEIGHT_M
        height = levels * LEVEL_HEIGHT_M + roof
    if not height:
        by_area = (height for largest, height in AREA_RULE if area_m2 <= largest)
        height = 3.0 if tags.get("building", "yes") in LOW_KINDS else next(by_area, LARGEST_AREA_HEIGHT_M)
    return round(min(400.0, max(2.0, height)), 2)

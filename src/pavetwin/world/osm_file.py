"""Reading OpenStreetMap files."""

from collections.abc import Iterator, Sequence
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
    """How the name of an OSM file of this content ends; empty where it is none."""
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

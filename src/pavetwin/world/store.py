"""Worlds on disk: a folder with `world.gpkg` (for QGIS and GIS tools), `roads.net.xml` (SUMO) and `world.yaml`.

The GeoPackage holds projected coordinates in the world's own CRS. The same world gives the same bytes.
"""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml
from shapely import Point

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, file_sha256, writing_folder
from pavetwin.world.build import BuildRecord, Built
from pavetwin.world.content import content_hash
from pavetwin.world.folder import DESCRIPTION, GEOPACKAGE, NETWORK, check_target, read_description, rebuild_hint
from pavetwin.world.georeference import GeoReference
from pavetwin.world.layers import read_layers, write_layers
from pavetwin.world.model import World

COUNTED = ("streets", "segments", "connections", "buildings", "furniture", "parking", "defects")
"""Collections whose sizes are in the description."""


def save_world(built: Built, folder: str | Path, *, force: bool = False) -> World:
    """Write a world as a folder, whole or not at all, and return it with its name and place.

    Raises:
        PaveTwinError: the folder exists (and `force` is false, or it is not a world), or cannot be written.
    """
    check_target(folder, force=force)
    folder = Path(folder).absolute()
    with writing_folder(folder, replace=force or folder.is_dir()) as place:
        write_layers(built.world, place / GEOPACKAGE)
        (place / NETWORK).write_bytes(built.network)
        text = yaml.safe_dump(_description(built), sort_keys=False, allow_unicode=True)
        (place / DESCRIPTION).write_text(text, encoding="utf-8")
    return replace(built.world, name=folder.name, folder=folder)


def _description(built: Built) -> dict[str, Any]:
    world, place = built.world, built.world.georeference
    lon, lat = (round(float(value), 7) for value in place.to_wgs84((world.base.x, world.base.y)))
    return {
        "format": FORMAT,
        "content_hash": world.content_hash,
        "defects_hash": world.defects_hash,
        **built.record.model_dump(mode="json"),
        "georeference": asdict(place),
        "left_hand": world.left_hand,
        "base": {"east_m": world.base.x, "north_m": world.base.y, "longitude": lon, "latitude": lat},
        "counts": {name: len(getattr(world, name)) for name in COUNTED},
    }


def load_world(folder: str | Path) -> World:
    """Read a world's folder; it equals the one that was saved.

    The content hash is computed again, so that recordings of a world are not reused after an edit in QGIS.

    Raises:
        PaveTwinError: it is not a world, a file of it is missing or damaged, or it is of another version.
    """
    folder = Path(folder)
    description = read_description(folder)
    try:
        place = description["georeference"]
        georeference = GeoReference(int(place["epsg"]), float(place["offset_east_m"]), float(place["offset_north_m"]))
        left_hand = description["left_hand"]
        if not isinstance(left_hand, bool):
            raise TypeError(f"left_hand, which is '{left_hand}' and not true or false")
        base = Point(*(float(description["base"][key]) for key in ("east_m", "north_m")))
    except (KeyError, TypeError, ValueError) as error:
        raise PaveTwinError(f"'{folder / DESCRIPTION}' is damaged (at {error}); {rebuild_hint(folder)}") from error
    layers = read_layers(folder / GEOPACKAGE, georeference, rebuild_hint(folder))
    world = World(
        name=folder.absolute().name,
        georeference=georeference,
        left_hand=left_hand,
        base=base,
        folder=folder.absolute(),
        **layers,
    )
    return replace(world, content_hash=content_hash(world, file_sha256(folder / NETWORK)))


def attribution(source: str) -> str | None:
    """The copyright notice for products of a world of that `source` (see `load_record`)."""
    return "© OpenStreetMap contributors" if source.endswith((".osm", ".osm.gz", ".osm.pbf")) else None


def load_record(folder: str | Path) -> BuildRecord:
    """Source and options of a saved world.

    Raises:
        PaveTwinError: as `load_world`.
    """
    folder = Path(folder)
    description = read_description(folder)
    fields = {name: description[name] for name in BuildRecord.model_fields if name in description}
    return BuildRecord.parse(fields, where=f"'{folder / DESCRIPTION}'")

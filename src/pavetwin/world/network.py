"""A SUMO road network from `.osm`, `.osm.gz`, `.osm.pbf`, or an existing `.net.xml`.

OpenStreetMap goes through two steps. First only the streets for motor traffic are kept (motorway … living_street; no
service roads, parking aisles, footways and cycleways of their own), and each urban street is given sidewalks on both
sides unless the map excludes them: a sidewalk mapped as a way of its own (`sidewalk=separate`) is dropped with
the other footways and would be missing. Then netconvert makes the network: junctions joined, crossings and traffic
lights guessed (actuated), only the largest connected part, UTM.

netconvert keeps only the largest connected part and drops the other streets without a warning; `LeftOut` counts them.
"""

import gzip
import re
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field
from pyproj import Geod

from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.world.folder import NET_SUFFIXES, OSM_SUFFIXES
from pavetwin.world.groups import groups
from pavetwin.world.osm_file import osm_objects
from pavetwin.world.sumo import NO_VALIDATION, data_file, run_tool

SPHERE: Final = Geod(a=6_371_009.0, b=6_371_009.0)
"""Sphere with the mean radius of the WGS 84 ellipsoid (IUGG) [m]."""

Degrees = tuple[float, float]
"""Longitude and latitude."""


class LeftOut(Settings):
    """Streets of a map that are not connected to the network; ways without a name count one each."""

    streets: Annotated[int, Field(ge=0)] = 0
    length_m: Annotated[float, Field(ge=0)] = 0.0


@dataclass(frozen=True, slots=True)
class _Way:
    id: int
    name: str
    nodes: tuple[int, ...]


def left_out(streets: Path, network: Path) -> LeftOut:
    """The streets of an OSM file that are missing in the network made from it.

    A street is in the network when any way connected with it is.

    Raises:
        PaveTwinError: the OSM file cannot be read.
    """
    places: dict[int, Degrees] = {}
    ways: list[_Way] = []
    for item in osm_objects(streets):
        if item.is_node():
            places[item.id] = (item.lon, item.lat)
        elif item.is_way() and len(item.nodes) > 1:
            ways.append(_Way(item.id, item.tags.get("name", ""), tuple(node.ref for node in item.nodes)))
    kept_ways = {int(name) for name in re.findall(r'<edge id="-?(\d+)', network.read_text(encoding="utf-8"))}
    group = groups(way.nodes for way in ways)
    kept = {group[way.nodes[0]] for way in ways if way.id in kept_ways}
    lost = [way for way in ways if group[way.nodes[0]] not in kept]
    length_m = sum(_length_m([places[node] for node in way.nodes if node in places]) for way in lost)
    return LeftOut(streets=len({way.name or str(way.id) for way in lost}), length_m=round(length_m, 1))


def _length_m(line: list[Degrees]) -> float:
    """Length along great circles."""
    return float(SPHERE.line_length([lon for lon, _ in line], [lat for _, lat in line]))


STREETS = frozenset(
    {"motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential", "living_street"}
)
"""Values of OSM's `highway` (and their `_link`s) that are inspected and driven on."""

WITHOUT_SIDEWALK = frozenset({"motorway", "trunk", "living_street"})
"""Streets that get a sidewalk only when the map has one; pedestrians use the whole of a living street."""

NETCONVERT_OPTIONS = (
    "--osm.sidewalks",
    "--osm.oneway-reverse-sidewalk",  # a one-way street's left sidewalk needs an edge of its own
    "--geometry.remove",  # nodes that only bend a street are not junctions
    "--geometry.min-dist=0.5",
    "--ramps.guess",
    "--junctions.join",
    "--tls.guess-signals",
    "--tls.discard-simple",
    "--tls.join",
    "--tls.default-type=actuated",
    "--crossings.guess",
    "--keep-edges.components=1",
    "--no-turnarounds.except-deadend",
    "--proj.utm",
    "--output.street-names",
    "--no-warnings",
    *NO_VALIDATION,
)


def source_kind(source: Path) -> str:
    """`osm` or `net`, by the file's name.

    Raises:
        PaveTwinError: the file is missing, or its name ends in none of the suffixes that can be read.
    """
    if not source.is_file():
        what = "is a folder" if source.is_dir() else "does not exist"
        there = source.parent.iterdir() if source.parent.is_dir() else ()
        beside = sorted(path.name for path in there if path.name.lower().endswith((*OSM_SUFFIXES, *NET_SUFFIXES)))
        near = nearest_name(source.name, beside)
        raise PaveTwinError(f"The source '{source}' {what}{near}; give an .osm, .osm.gz, .osm.pbf or .net.xml file.")
    name = source.name.lower()
    if name.endswith(OSM_SUFFIXES):
        return "osm"
    if name.endswith(NET_SUFFIXES):
        return "net"
    raise PaveTwinError(
        f"'{source}' has a suffix that is not known; a world is built from .osm, .osm.gz, .osm.pbf or .net.xml."
    )


def network_from_osm(source: Path, target: Path, *, left_hand: bool = False) -> LeftOut:
    """Write the SUMO network of an OSM file to `target`; returns the streets not connected with it.

    Raises:
        PaveTwinError: the file is cut short or no OSM, it has no streets, or SUMO is missing.
    """
    with tempfile.TemporaryDirectory(prefix="pavetwin-") as folder:
        streets = Path(folder) / "streets.osm"
        if write_streets(source, streets) == 0:
            raise PaveTwinError(f"'{source}' has no streets for cars (ways tagged highway=residential or the like).")
        types = ",".join(str(data_file(f"typemap/osmNetconvert{part}.typ.xml")) for part in ("", "Pedestrians"))
        made = Path(folder) / "roads.net.xml"
        arguments = ["--osm-files", str(streets), "--type-files", types, "--output-file", str(made)]
        if left_hand:
            arguments.append("--lefthand")
        doing = f"Cannot build the road network of '{source}'"
        run_tool("netconvert", [*arguments, *NETCONVERT_OPTIONS], doing=doing)
        copy_without_stamp(made, target)
        return left_out(streets, target)


def network_from_net(source: Path, target: Path) -> None:
    """Copy a user's own SUMO network as it is, unpacked when it is gzipped.

    Raises:
        PaveTwinError: it cannot be read.
    """
    try:
        if source.name.lower().endswith(".gz"):
            with gzip.open(source, "rb") as packed, target.open("wb") as plain:
                shutil.copyfileobj(packed, plain)
        else:
            shutil.copyfile(source, target)
    except (EOFError, gzip.BadGzipFile) as error:
        raise PaveTwinError(f"'{source}' is cut short or no gzip file ({error}); fetch it again.") from error


def copy_without_stamp(made: Path, target: Path) -> None:
    """Copy a network without netconvert's leading comment, whose date and paths differ in every run."""
    text = made.read_text(encoding="utf-8")
    head, begin, body = text.partition("<net ")
    head = re.sub(r"<!--.*?-->\s*", "", head, flags=re.DOTALL)
    target.write_text(head + begin + body, encoding="utf-8")


def write_streets(source: Path, target: Path) -> int:
    """Copy the streets of an OSM file, their nodes and turn restrictions to a plain `.osm`; return the number of ways.

    Raises:
        PaveTwinError: the file cannot be read to its end.
        OSError: the copy cannot be written.
    """
    import osmium

    street_nodes: set[int] = set()
    streets = 0
    for way in osm_objects(source, only_ways=True):
        if is_street(way.tags):
            streets += 1
            street_nodes.update(node.ref for node in way.nodes)
    if streets == 0:
        return 0
    try:
        with osmium.SimpleWriter(str(target)) as writer:
            for item in osm_objects(source):
                if item.is_node() and item.id in street_nodes:
                    writer.add(item)
                elif item.is_way() and is_street(item.tags):
                    writer.add(item.replace(tags=with_sidewalks({tag.k: tag.v for tag in item.tags})))
                elif item.is_relation() and item.tags.get("type") == "restriction":
                    writer.add(item)
    except RuntimeError as error:  # what osmium raises when the disk is full
        raise OSError(str(error)) from error
    return streets


def is_street(tags: Any) -> bool:
    """Whether an OSM way is one of the streets that the world is made of."""
    kind = tags.get("highway", "").removesuffix("_link")
    return kind in STREETS and tags.get("area") != "yes"


def with_sidewalks(tags: dict[str, str]) -> dict[str, str]:
    """A street's tags with `sidewalk` in the form that netconvert reads: both, left, right or none."""
    given = {key: value for key, value in tags.items() if key.split(":")[0] == "sidewalk"}
    kept = {key: value for key, value in tags.items() if key not in given}
    urban = tags["highway"].removesuffix("_link") not in WITHOUT_SIDEWALK and tags.get("motorroad") != "yes"
    plain = given.get("sidewalk", "")
    if plain in ("both", "left", "right"):
        side = plain
    elif plain in ("no", "none") or given.get("sidewalk:both") in ("no", "none"):
        side = "none"
    elif urban and tags.get("junction") not in ("roundabout", "circular"):
        sides = [name for name in ("left", "right") if given.get(f"sidewalk:{name}") not in ("no", "none")]
        side = {2: "both", 0: "none"}.get(len(sides)) or sides[0]
    else:
        side = "none"
    return {**kept, "sidewalk": side}

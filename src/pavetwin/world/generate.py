"""Generated road networks: the demo town, or one of netgenerate's grids, spider webs and random nets.

The world frame is the network's own, in metres, its origin at the anchor. The same kind, seed and anchor give the same
bytes: SUMO's time stamps are removed.
"""

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from pyproj import CRS
from shapely import Polygon, STRtree

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.world.georeference import DEFAULT_ANCHOR_DEG, GeoReference, anchored
from pavetwin.world.model import Building
from pavetwin.world.network import copy_without_stamp
from pavetwin.world.parking.lanes import EdgeLanes, insert_lanes
from pavetwin.world.roadnet import read_roadnet
from pavetwin.world.sumo import NO_VALIDATION, run_tool
from pavetwin.world.town_buildings import SHIFT_M, build_town
from pavetwin.world.town_roads import write_plain


class NetworkKind(StrEnum):
    TOWN = "town"
    GRID = "grid"
    SPIDER = "spider"
    RANDOM = "random"


@dataclass(frozen=True, slots=True)
class SourceNetwork:
    """A network file in a temporary folder. Parks and buildings are empty where the world's rules place them."""

    net_file: Path
    georeference: GeoReference | None = None
    """Georeference; None where the file states its own."""
    parks: tuple[Polygon, ...] = ()
    buildings: tuple[Building, ...] = ()


CORNERS = ("--junctions.corner-detail=5",)

NETWORK_OPTIONS = (
    "--tls.guess=false",
    "--tls.default-type=actuated",
    "--crossings.guess",
    "--crossings.guess.speed-threshold=13.9",
    "--no-turnarounds.except-deadend",
    *CORNERS,
    "--default.crossing-width=3.5",
    "--offset.disable-normalization",
    "--output.street-names",
    "--no-warnings",
    *NO_VALIDATION,
)

_SIDEWALKS = ("--sidewalks.guess", "--sidewalks.guess.from-permissions", "--default.sidewalk-width=2")

_SHAPES = {
    NetworkKind.GRID: (
        "grid grid.x-number=5 grid.y-number=4 grid.x-length=130 grid.y-length=105 grid.attach-length=70 "
        "perturb-x=normc(0,7,-12,12) perturb-y=normc(0,7,-12,12)"
    ),
    NetworkKind.SPIDER: (
        "spider spider.arm-number=7 spider.circle-number=3 spider.space-radius=95 spider.attach-length=60 "
        "spider.omit-center"
    ),
    NetworkKind.RANDOM: (
        "rand rand.iterations=55 rand.min-distance=70 rand.max-distance=150 rand.min-angle=50 "
        "rand.neighbor-dist1=0 rand.neighbor-dist2=3 rand.neighbor-dist5=0 rand.neighbor-dist6=0"
    ),
}
"""Options of netgenerate, without their dashes."""


def network_kind(name: str) -> NetworkKind:
    """The kind of that name.

    Raises:
        PaveTwinError: there is none; the message names the nearest.
    """
    try:
        return NetworkKind(name)
    except ValueError:
        known = [kind.value for kind in NetworkKind]
        raise PaveTwinError(no_such("kind of network", name, known, key="`generate`")) from None


def generate_network(
    kind: NetworkKind | str, seed: int, folder: Path, *, anchor: tuple[float, float] = DEFAULT_ANCHOR_DEG
) -> SourceNetwork:
    """Write `roads.net.xml` of a kind and seed into `folder`; `anchor` is (latitude, longitude) of its origin, degrees.

    Raises:
        PaveTwinError: an unknown kind, a negative seed, an anchor off the map, or SUMO is missing.
    """
    kind = network_kind(kind)
    if seed < 0:
        raise PaveTwinError(f"The seed {seed} is negative; use 0 or a larger whole number.")
    georeference = anchored(*anchor)
    target = folder / "roads.net.xml"
    parks: tuple[Polygon, ...] = ()
    buildings: tuple[Building, ...] = ()
    with tempfile.TemporaryDirectory(prefix="pavetwin-") as place:
        made = Path(place) / "made.net.xml"
        if kind is NetworkKind.TOWN:
            town = build_town(seed)
            nodes, edges = write_plain(town.roads, Path(place), SHIFT_M)
            inputs = ("--node-files", str(nodes), "--edge-files", str(edges))
            _run("netconvert", (*inputs, *NETWORK_OPTIONS), made, kind)
            parks, buildings = town.parks, _clear_of_streets(town.buildings, made)
        else:
            _generate(kind, seed, made)
        copy_without_stamp(made, target)
    _write_location(target, georeference)
    return SourceNetwork(target, georeference, parks, buildings)


def with_parking_lanes(
    made: SourceNetwork, kind: NetworkKind | str, seed: int, lanes: Mapping[str, EdgeLanes], target: Path
) -> SourceNetwork:
    """A generated network with parking lanes, written to `target`; a town's houses and park give way to them.

    Raises:
        PaveTwinError: netconvert failed, or SUMO is missing.
    """
    insert_lanes(made.net_file, lanes, target, CORNERS, left_hand=False)
    if network_kind(kind) is not NetworkKind.TOWN:
        return replace(made, net_file=target)
    widths: dict[str, float] = {}
    for edge, changed in lanes.items():
        road = edge.removeprefix("-")
        widths[road] = max(widths.get(road, 0.0), changed.kerb_m, changed.far_m)
    town = build_town(seed, widths)
    return replace(made, net_file=target, parks=town.parks, buildings=_clear_of_streets(town.buildings, target))


def _clear_of_streets(buildings: tuple[Building, ...], net_file: Path) -> tuple[Building, ...]:
    """The buildings at least 0.5 m from netconvert's roads, whose junctions extend beyond their streets."""
    net = read_roadnet(net_file)
    lanes = [lane for edge in net.edges.values() for lane in edge.lanes]
    paved: list[Polygon] = [lane.centre_line.buffer(lane.width_m / 2 + 0.5, cap_style="flat") for lane in lanes]
    paved += [junction.polygon.buffer(0.5) for junction in net.junctions]
    hit = set(STRtree(paved).query([building.polygon for building in buildings], predicate="intersects")[0])
    return tuple(building for number, building in enumerate(buildings) if number not in hit)


def _generate(kind: NetworkKind, seed: int, made: Path) -> None:
    """A network of netgenerate's, then signals at its large junctions by netconvert."""
    plain = made.with_name("plain.net.xml")
    shape = (f"--{option}" for option in _SHAPES[kind].split())
    lanes = ("--default.lanenumber=2", "--random-lanenumber", "--default.speed=13.89", "--default.lanewidth=3.2")
    seeded = ("--seed", str(seed % 2**31))
    _run("netgenerate", (*shape, *lanes, *seeded, "--no-warnings", *NO_VALIDATION), plain, kind)
    options = [option for option in NETWORK_OPTIONS if not option.startswith("--tls.guess")]
    signals = ("--tls.guess", "--tls.guess.threshold=95")
    _run("netconvert", ("--sumo-net-file", str(plain), *options, *_SIDEWALKS, *signals), made, kind)


def _run(tool: str, options: tuple[str, ...], made: Path, kind: NetworkKind) -> None:
    run_tool(tool, [*options, "--output-file", str(made)], doing=f"Cannot generate a {kind.value} network")


def _write_location(net_file: Path, georeference: GeoReference) -> None:
    """State the georeference in the network itself, so that SUMO's own tools and a re-import know it too."""
    text = net_file.read_text(encoding="utf-8")
    bounds = re.search(r'convBoundary="([^"]*)"', text)
    if bounds is None:
        raise PaveTwinError("SUMO wrote a network without its boundary; is this version of SUMO supported (1.28)?")
    x0, y0, x1, y1 = (float(value) for value in bounds.group(1).split(","))
    degrees = georeference.to_wgs84([(x0, y0), (x1, y1)]).ravel()
    location = (
        f'<location netOffset="{-georeference.offset_east_m:.2f},{-georeference.offset_north_m:.2f}" '
        f'convBoundary="{bounds.group(1)}" origBoundary="{",".join(f"{value:.6f}" for value in degrees)}" '
        f'projParameter="{_proj(georeference.epsg)}"/>'
    )
    net_file.write_text(re.sub(r"<location [^>]*/>", location, text, count=1), encoding="utf-8")


def _proj(epsg: int) -> str:
    """SUMO's way of naming a UTM zone."""
    zone = CRS.from_epsg(epsg).utm_zone
    if zone is None:
        raise PaveTwinError(f"EPSG:{epsg} is not a UTM zone.")
    south = " +south" if zone.endswith("S") else ""
    return f"+proj=utm +zone={zone[:-1]}{south} +ellps=WGS84 +datum=WGS84 +units=m +no_defs"

"""Tiny road networks for traffic, made by netconvert from a few lines: a straight street, a signalled cross, and an
arterial without signals."""

from functools import cache
from math import exp
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from shapely import Point

from pavetwin.traffic.demand import LevelOfService
from pavetwin.traffic.demand_search import DemandSearch, Trial
from pavetwin.traffic.recording import Recording
from pavetwin.world.georeference import GeoReference
from pavetwin.world.model import World
from pavetwin.world.roadnet import read_roadnet
from pavetwin.world.sumo import run_tool

SOURCES = Path(__file__).resolve().parents[2] / "src"

ROUTES = """<routes>
  <vType id="lorry" vClass="truck" length="8.5" width="2.4" height="3.2"/>
  <vType id="plain"/>
  <vehicle id="1" type="lorry" depart="3600"><route edges="wc ce"/></vehicle>
  <person id="1" depart="3600"><walk edges="ce"/></person>
  <vehicle id="2" type="plain" depart="3601"><route edges="wc ce"/></vehicle>
  <person id="rider" depart="3602" departPos="5"><ride from="nc" to="cs" lines="taxi"/></person>
  <vehicle id="taxi" type="plain" depart="3602" departPos="20">
    <route edges="nc cs"/><stop lane="nc_1" startPos="0" endPos="40" duration="5" triggered="true"/>
  </vehicle>
</routes>"""

_NODES = {
    "straight": [("a", 0, 0, "priority"), ("b", 600, 0, "priority")],
    "short": [("a", 0, 0, "priority"), ("b", 120, 0, "priority")],
    "cross": [
        ("c", 0, 0, "traffic_light"),
        ("w", -300, 0, "priority"),
        ("e", 300, 0, "priority"),
        ("s", 0, -250, "priority"),
        ("n", 0, 250, "priority"),
    ],
    "arterial": [
        *((name, x, 0, "priority") for name, x in (("a", 0), ("b", 500), ("c", 1000), ("d", 1500))),
        ("n", 500, 150, "priority"),
        ("s", 1000, -150, "priority"),
    ],
}
_STREETS = {
    "straight": [("a", "b")],
    "short": [("a", "b")],
    "cross": [("w", "c"), ("c", "e"), ("s", "c"), ("c", "n")],
    "arterial": [("a", "b"), ("b", "c"), ("c", "d"), ("n", "b"), ("c", "s")],
}


def make_network(scene: str, target: Path, *, sidewalks: bool = True) -> Path:
    """Write the SUMO network of a scene: two-way streets at 50 km/h, a lane and a sidewalk in each direction."""
    target.parent.mkdir(parents=True, exist_ok=True)
    # A comment keeps the recordings of two scenes apart in the cache.
    target.write_bytes(_network(scene, sidewalks) + f"<!-- {target} -->\n".encode())
    return target


@cache
def _network(scene: str, sidewalks: bool) -> bytes:
    with TemporaryDirectory() as folder:
        return _converted(scene, sidewalks, Path(folder))


def _converted(scene: str, sidewalks: bool, folder: Path) -> bytes:
    nodes, edges, target = (folder / name for name in ("plain.nod.xml", "plain.edg.xml", "roads.net.xml"))
    nodes.write_text(
        "<nodes>"
        + "".join(f'<node id="{i}" x="{x}" y="{y}" type="{kind}"/>' for i, x, y, kind in _NODES[scene])
        + "</nodes>"
    )
    walk = 'sidewalkWidth="2"' if sidewalks else ""
    edges.write_text(
        "<edges>"
        + "".join(
            f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="1" speed="13.89" {walk}/>'
            for pair in _STREETS[scene]
            for a, b in (pair, pair[::-1])
        )
        + "</edges>"
    )
    files = ["-n", str(nodes), "-e", str(edges), "-o", str(target)]
    options = ["--no-warnings", "--offset.disable-normalization", *["--crossings.guess"] * sidewalks]
    run_tool("netconvert", [*files, *options], doing="making a scene")
    return target.read_bytes()


def world_on(net_file: Path, content_hash: str = "scene") -> World:
    """A world with nothing but streets, in the folder of its network."""
    net = read_roadnet(net_file)
    return World(
        name=net_file.parent.name,
        georeference=GeoReference(32632, 500000.0, 5000000.0),
        left_hand=net.left_hand,
        streets=(),
        segments=(),
        lanes=tuple(lane for edge in net.edges.values() for lane in edge.lanes),
        connections=net.connections,
        junctions=net.junctions,
        crossings=net.crossings,
        buildings=(),
        furniture=(),
        parks=(),
        defects=(),
        base=Point(0, 0),
        content_hash=content_hash,
        folder=net_file.parent,
    )


def scene_world(scene: str, folder: Path, *, sidewalks: bool = True) -> World:
    """The world of a scene, written below `folder`."""
    return world_on(make_network(scene, folder / scene / "roads.net.xml", sidewalks=sidewalks))


def bytes_of(recording: Recording) -> bytes:
    assert recording.path is not None
    return recording.path.read_bytes()


EMPTY_RATIO = 0.72
SCALE_PER_LANE_KM = 11.0
FREE_FLOW_KMH = 45.0


def on_the_curve(search: DemandSearch, *counts: int, empty_ratio: float = EMPTY_RATIO) -> list[Trial]:
    """Results of trials in a network that follows the curve of `demand_search` exactly."""
    trials = []
    search._report(1.0)
    for count in counts:
        density = count / search._inputs.capacity.lanes_km
        ratio = empty_ratio * exp(-0.5 * (density / SCALE_PER_LANE_KM) ** 2)
        trials.append(Trial(round(density, 3), round(ratio, 4), round(density * FREE_FLOW_KMH * ratio, 2), 0.0))
    return trials


def know_demand(world: World, *mixes: str) -> None:
    """Keep the trials of all levels that a town reaches in the world's cache: a search of it simulates nothing then."""
    with patch.object(DemandSearch, "_simulated", on_the_curve):
        for mix in mixes or ("europe",):
            for level in list(LevelOfService)[1:]:
                DemandSearch(world, mix).of_level(level)

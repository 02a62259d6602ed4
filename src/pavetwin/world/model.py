"""The values of a static world: streets, segments, buildings, furniture, defects.

The world frame is east-north-up in metres and equal to the frame of the world's SUMO network. `GeoReference` converts
it to WGS 84.

The carriageway is the only definition of the road surface: the segments, and the part of each junction between its
arms. Scenes and maps draw it, nothing is placed on it, images measure it. Each segment's polygon is its part of it, and
densities per square metre use the area of that polygon. Junction areas belong to no segment.
"""

import hashlib
import unicodedata
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import GeometryArray
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.world.georeference import GeoReference
from pavetwin.world.parking.place import ParkingPlace

_TOUCH_M = 0.4  # A segment that ends within this of a junction is one of its arms

_ROUND_M = 2.2  # Gaps of twice as much between the arms of a junction are closed [m]

_CORNER_RADIUS_M = 7.0
"""Least radius of a kerb around a corner; 6 to 8 m are built where streets cross squarely (RASt 06)."""

_SPECK_M2 = 1.0  # Smaller islands and holes have no kerb of their own


def carriageway(arms: Sequence[BaseGeometry], junctions: Sequence[BaseGeometry]) -> BaseGeometry:
    """The surface as one shape, metres, world frame; `World.carriageway` keeps it.

    Corners of junctions are rounded as kerbs are built. No arm reaches out of it by more than 2 cm.

    Args:
        arms: the polygons of segments and of crossings. A crossing counts as an arm for the places where two junctions
            meet.
        junctions: their polygons as SUMO has them, with the corners of sidewalks.
    """
    whole = shapely.union_all([_unrounded(arms, np.array(junctions, dtype=object))])
    return _without_specks(_with_corners(whole, junctions))


def _unrounded(arms: Sequence[BaseGeometry], junctions: GeometryArray) -> BaseGeometry:
    """All arms and the driven part of all junctions: the hull of the arms' ends excludes the corners of sidewalks."""
    parts: list[BaseGeometry] = list(arms)
    if len(junctions):
        near = shapely.buffer(junctions, _TOUCH_M)
        which, arm = STRtree(arms).query(near, predicate="intersects")
        ends = shapely.intersection(np.array(arms, dtype=object)[arm], near[which])
        for index in range(len(junctions)):
            hull = shapely.convex_hull(shapely.union_all(ends[which == index]))
            parts.append(shapely.intersection(hull, near[index]))
    whole = shapely.buffer(shapely.union_all(shapely.buffer(np.array(parts, dtype=object), 0.1)), -0.1)
    rounded = shapely.buffer(shapely.buffer(whole, _ROUND_M), -_ROUND_M)
    at_junctions = shapely.intersection(rounded, shapely.union_all(shapely.buffer(junctions, 2 * _ROUND_M)))
    return shapely.union(whole, shapely.buffer(at_junctions, 0))


def _with_corners(road: BaseGeometry, junctions: Sequence[BaseGeometry]) -> BaseGeometry:
    """The carriageway with rounded corners at junctions, as kerbs are built."""
    if not junctions:
        return road
    closed = road.buffer(_CORNER_RADIUS_M, quad_segs=8).buffer(-_CORNER_RADIUS_M, quad_segs=8)
    added = shapely.get_parts(shapely.difference(closed, road))
    corners = np.unique(STRtree(junctions).query(added, "dwithin", distance=1.0)[0])
    return shapely.union_all([road, *shapely.buffer(added[corners], 0.005)])


def _without_specks(road: BaseGeometry) -> BaseGeometry:
    """Without islands and holes too small for a kerb of their own, and without near-duplicate points."""
    parts = []
    for part in shapely.get_parts(shapely.simplify(road, 0.01)):
        if isinstance(part, Polygon) and part.area >= _SPECK_M2:
            rings = [ring for ring in part.interiors if Polygon(ring).area >= _SPECK_M2]
            parts.append(Polygon(part.exterior, rings))
    return shapely.make_valid(shapely.union_all(parts))


Surface = Polygon | MultiPolygon


class LaneKind(StrEnum):
    DRIVING = "driving"
    SIDEWALK = "sidewalk"
    BICYCLE = "bicycle"
    PARKING = "parking"
    """Parking lane along the kerb; not driven on."""


CARRIAGEWAY_LANES = (LaneKind.DRIVING, LaneKind.BICYCLE, LaneKind.PARKING)
"""Kinds of lanes that a carriageway is made of."""


@dataclass(frozen=True, slots=True)
class Lane:
    """Lane of a SUMO edge, between its junctions."""

    id: str
    edge: str
    index: int
    """SUMO's: 0 at the kerb, rising towards the middle of the street."""
    kind: LaneKind
    centre_line: LineString
    width_m: float
    speed_limit_mps: float

    @property
    def length_m(self) -> float:
        return float(self.centre_line.length)


@dataclass(frozen=True, slots=True)
class Street:
    """Street between two junctions: one directed SUMO edge, or two parallel ones."""

    id: str
    """The ids of its edges, joined by spaces; it does not depend on other streets."""
    name: str
    """Name on the map, or the edge's id without one; `Segment.street_name` is the displayed name."""
    kind: str
    """SUMO's edge type, such as `highway.residential`; empty where the source gives none."""
    edges: tuple[str, ...]
    """The directed edges; the centre line runs along the first, the second runs back."""
    start: str
    """The junction at which the centre line begins."""
    end: str
    """The junction at which the centre line ends."""
    centre_line: LineString
    """Centre line of the carriageway, from junction to junction."""
    latin_name: str = field(default="", hash=False)
    """Name in Latin letters if the map has one besides a name in another script; not part of content hashes."""
    bridges: tuple[tuple[float, float], ...] = field(default=(), hash=False)
    """Stations of its centre line between which it lies on a bridge [m]; not part of content hashes."""

    @property
    def length_m(self) -> float:
        return float(self.centre_line.length)

    @property
    def key(self) -> int:
        """A number derived from the id alone; it keys the random seeds of this street."""
        return zlib.crc32(self.id.encode())

    def end_of(self, edge: str) -> str:
        """The junction that one of its edges leads to."""
        return self.end if edge == self.edges[0] else self.start


class Direction(StrEnum):
    """Direction of a connection, as SUMO computed it."""

    STRAIGHT = "straight"
    LEFT = "left"
    RIGHT = "right"
    PARTLY_LEFT = "partly_left"
    PARTLY_RIGHT = "partly_right"
    TURNAROUND = "turnaround"
    UNKNOWN = "unknown"


class SignalLink(NamedTuple):
    """Position of a letter in a traffic light's state."""

    controller: str
    """SUMO's id of the traffic light."""
    link: int
    """The place of the letter, from 0."""


@dataclass(frozen=True, slots=True)
class Connection:
    """Path across a junction: from the end of a lane to the beginning of another."""

    from_lane: str
    to_lane: str
    direction: Direction
    signal: SignalLink | None
    """The signal that controls it; None without a traffic light."""
    via: str
    """SUMO's internal lane on which it begins; empty in a network without internal lanes."""
    centre_line: LineString
    """Line from the end of the first lane along SUMO's internal lanes to the beginning of the second."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A piece of one street's carriageway between junctions: what is inspected as one unit (a member of S)."""

    id: str
    street: str
    """The street's name on the map, or its SUMO edge when it has none: what segments are grouped by."""
    edges: tuple[str, ...]
    """Directed SUMO edges: one for a one-way street, two otherwise."""
    centre_line: LineString
    polygon: Surface
    width_m: float
    """Mean width of the carriageway (driving and bicycle lanes, without sidewalks)."""
    lanes: int

    @property
    def length_m(self) -> float:
        return float(self.centre_line.length)

    @property
    def has_street_name(self) -> bool:
        return self.street not in {name for edge in self.edges for name in (edge, edge.removeprefix("-"))}

    @property
    def street_name(self) -> str:
        """The street's name as people read it: `Bell Lane`, or `unnamed street, s0002`."""
        return self.street if self.has_street_name else f"unnamed street, {self.id}"

    @property
    def label(self) -> str:
        """`Bell Lane, s0002`, or `unnamed street, s0002`."""
        return f"{self.street}, {self.id}" if self.has_street_name else self.street_name

    @property
    def area_m2(self) -> float:
        return float(self.polygon.area)


@dataclass(frozen=True, slots=True)
class Junction:
    id: str
    kind: str
    """SUMO's type: priority, traffic_light, right_before_left, dead_end …"""
    polygon: Surface


@dataclass(frozen=True, slots=True)
class Crossing:
    """A pedestrian crossing on the carriageway of a junction's arm."""

    id: str
    polygon: Polygon
    signal: SignalLink | None
    """The signal for its pedestrians; None without a traffic light."""

    @property
    def signalled(self) -> bool:
        return self.signal is not None


@dataclass(frozen=True, slots=True)
class Building:
    id: str
    polygon: Polygon
    height_m: float


class FurnitureKind(StrEnum):
    TREE = "tree"
    STREET_LIGHT = "street_light"
    POLE = "pole"
    SIGN = "sign"
    SIGNAL = "signal"


@dataclass(frozen=True, slots=True)
class Furniture:
    """Upright object along the road. `arm_m` reaches from the mast's top along `yaw_rad` (lights, signals)."""

    id: str
    kind: FurnitureKind
    position: Point
    height_m: float
    radius_m: float
    """Radius of the mast, or of a tree's crown."""
    yaw_rad: float = 0.0
    arm_m: float = 0.0
    clear_height_m: float = 0.0
    """Height at which a tree's crown begins; the underside of an arm is at `height_m`."""
    controller: str = ""
    """SUMO's traffic light that a signal shows."""


class Severity(StrEnum):
    """Severity by ASTM D6433; `pavetwin.defects.severity` has the rules."""

    LOW = "low"
    MEDIUM = "medium"
    HIGH = "high"


def is_class_name(name: str) -> bool:
    """Whether a name may be a class of defects: a lower-case identifier."""
    return name.isidentifier() and name.islower()


ShapeParameters = tuple[tuple[str, float], ...]
"""Parameters of a class of defects that have one value, by name."""


@dataclass(frozen=True, slots=True)
class Defect:
    id: int
    """0 … n−1 in the order of the world's defects."""
    segment: str
    kind: str
    """Class: a lower-case identifier such as `pothole`."""
    centre: Point
    """Origin of its local frame."""
    polygon: Polygon
    """Outline, for labels and drawing."""
    seed: int
    """Seed of its shape; `pavetwin.defects.heightfield_of` regenerates the shape from it."""
    yaw_rad: float
    """Direction of its local x axis."""
    severity: Severity
    width_m: float
    """Widest opening of a crack; mean diameter of a pothole; for a user's class the value of its `width`."""
    depth_m: float
    """Maximum depth."""
    length_m: float
    """Total length of its cracks; of a user's class without cracks the longer side of the smallest rectangle around
    it, unless the class defines `length`."""
    volume_m3: float
    """Volume missing below the road surface."""
    parameters: ShapeParameters = ()
    """Shape parameters drawn by a damage population; the rest comes from the seed."""
    notch: tuple[tuple[float, float], ...] = ()
    """Ring in its local frame [m] within which it has been lost to a defect that lies there: to a pothole in a network;
    empty for nothing."""
    beside: str = ""
    """Feature that it starts at or runs along (`pavetwin.defects.context`): `cover`, `patch`, `trench`; or empty."""

    def __post_init__(self) -> None:
        if not is_class_name(self.kind):
            raise ValueError(f"'{self.kind}' cannot name a class of defects; use lower-case letters, digits and _")

    @property
    def area_m2(self) -> float:
        return float(self.polygon.area)

    @property
    def facts(self) -> dict[str, str | float]:
        """Properties for labels and exported scenes; lengths to 0.1 mm."""
        return {
            "class": self.kind,
            "severity": self.severity.value,
            "width_m": round(self.width_m, 4),
            "depth_m": round(self.depth_m, 4),
            "length_m": round(self.length_m, 4),
            "area_m2": round(self.area_m2, 4),
            "segment": self.segment,
        }


_HASHED_APART = ("polygon", "centre", "parameters", "notch", "beside")


def defects_hash(defects: Sequence[Defect]) -> str:
    """SHA-256 over defects in their order. Empty parameters, notches and neighbours do not enter it."""
    names = sorted(each.name for each in fields(Defect) if each.name not in _HASHED_APART)
    polygons = shapely.to_wkb(np.array([defect.polygon for defect in defects], dtype=object))
    centres = shapely.to_wkb(np.array([defect.centre for defect in defects], dtype=object))
    digest = hashlib.sha256()
    for defect, polygon, centre in zip(defects, polygons, centres, strict=True):
        values = {name: str(getattr(defect, name)) for name in names}
        if defect.parameters:
            values["parameters"] = str(defect.parameters)
        if defect.notch:
            values["notch"] = str(defect.notch)
        if defect.beside:
            values["beside"] = defect.beside
        digest.update(repr(sorted(values.items())).encode() + polygon + centre)
    return digest.hexdigest()


def _plain(name: str) -> str:
    """A name as it is compared: composed, without regard to case and to spaces around it."""
    return unicodedata.normalize("NFC", name).casefold().strip()


@dataclass(frozen=True)
class World:
    """The segments S and everything static around them."""

    name: str
    georeference: GeoReference
    left_hand: bool
    """Traffic keeps left."""
    streets: tuple[Street, ...]
    """Streets in the order of their segments."""
    segments: tuple[Segment, ...]
    lanes: tuple[Lane, ...]
    """Sidewalks last."""
    connections: tuple[Connection, ...]
    """Between the lanes above, in the network's order."""
    junctions: tuple[Junction, ...]
    crossings: tuple[Crossing, ...]
    buildings: tuple[Building, ...]
    furniture: tuple[Furniture, ...]
    parks: tuple[Polygon, ...]
    defects: tuple[Defect, ...]
    base: Point
    """Place of take-off and landing."""
    parking: tuple[ParkingPlace, ...] = ()
    """Along the streets, in their order."""
    content_hash: str = ""
    """SHA-256 of everything above except the defects; identifies the world of a recording or a navmesh."""
    folder: Path | None = field(default=None, compare=False)
    """The folder that it was loaded from; holds `roads.net.xml`."""

    @cached_property
    def defects_hash(self) -> str:
        """SHA-256 of the defects."""
        return defects_hash(self.defects)

    @cached_property
    def carriageway(self) -> BaseGeometry:
        """The road surface as it is built: the one definition for scenes, maps, labels and placement."""
        arms = [*(segment.polygon for segment in self.segments), *(crossing.polygon for crossing in self.crossings)]
        return carriageway(arms, [junction.polygon for junction in self.junctions])

    @cached_property
    def outside_segments_m2(self) -> float:
        """Area of the carriageway that belongs to no segment: junctions and crossings, never inspected [m²]."""
        inspected = shapely.union_all([segment.polygon for segment in self.segments])
        return float(self.carriageway.difference(inspected).area)

    @cached_property
    def _segment_by_id(self) -> dict[str, Segment]:
        return {segment.id: segment for segment in self.segments}

    def segment(self, segment_id: str) -> Segment:
        """The segment named `segment_id`.

        Raises:
            PaveTwinError: there is none; the message names the nearest.
        """
        try:
            return self._segment_by_id[segment_id]
        except KeyError:
            raise PaveTwinError(
                f"No segment '{segment_id}' in the world '{self.name}'"
                f"{nearest_name(segment_id, self._segment_by_id)}. `pavetwin world show WORLD --ids` draws their ids."
            ) from None

    def segments_named(self, name: str) -> tuple[Segment, ...]:
        """The segment of that id, or those of all streets of that name, in Latin letters too and in any case.

        Raises:
            PaveTwinError: there is none; the message names the nearest.
        """
        if found := self._segment_by_id.get(name):
            return (found,)
        by_name: dict[str, list[Segment]] = {}
        shown: dict[str, str] = {}
        for segment in self.segments:
            for each in {segment.street, self.latin_name_of(segment)} if segment.has_street_name else ():
                by_name.setdefault(_plain(each), []).append(segment)
                shown[_plain(each)] = each
        if _plain(name) in by_name:
            return tuple(by_name[_plain(name)])
        near = nearest_name(name, [*self._segment_by_id, *shown.values()])
        raise PaveTwinError(
            f"No segment or street '{name}' in the world '{self.name}'{near}. "
            "`pavetwin world show WORLD --ids` draws names and ids."
        )

    @cached_property
    def _latin_names(self) -> dict[tuple[str, ...], str]:
        return {street.edges: street.latin_name for street in self.streets if street.latin_name}

    def latin_name_of(self, segment: Segment) -> str:
        """The name of a segment's street in Latin letters; as it is where the map has no other."""
        return self._latin_names.get(segment.edges, segment.street)

    @cached_property
    def _junction_by_id(self) -> dict[str, Junction]:
        return {junction.id: junction for junction in self.junctions}

    def junction(self, junction_id: str) -> Junction | None:
        """The junction of that id; None where it has no surface, as at many dead ends."""
        return self._junction_by_id.get(junction_id)

    @cached_property
    def lanes_by_edge(self) -> dict[str, tuple[Lane, ...]]:
        """The lanes of each directed edge from the kerb to the middle of the street."""
        by_edge: dict[str, list[Lane]] = {}
        for lane in self.lanes:
            by_edge.setdefault(lane.edge, []).append(lane)
        return {edge: tuple(sorted(lanes, key=lambda lane: lane.index)) for edge, lanes in by_edge.items()}

    def lanes_on(self, edge: str, *kinds: LaneKind) -> tuple[Lane, ...]:
        """The lanes of a directed edge from the kerb to the middle of the street, of some kinds or of all."""
        lanes = self.lanes_by_edge.get(edge, ())
        return tuple(lane for lane in lanes if lane.kind in kinds) if kinds else lanes

    def beside(self, lane: Lane, towards_middle_m: float) -> BaseGeometry:
        """A lane's centre line moved towards the middle of its street; below 0 towards the kerb."""
        line: BaseGeometry = shapely.offset_curve(
            lane.centre_line, -towards_middle_m if self.left_hand else towards_middle_m
        )
        return line

    def defects_of(self, segment_id: str) -> Iterator[Defect]:
        return (defect for defect in self.defects if defect.segment == segment_id)

    def lanes_of(self, kind: LaneKind) -> Sequence[Lane]:
        return [lane for lane in self.lanes if lane.kind is kind]

    def length_km(self, kind: LaneKind) -> float:
        """Summed length of all lanes of a kind, in kilometres: the denominator of the traffic density."""
        return sum(lane.length_m for lane in self.lanes if lane.kind is kind) / 1000

    @property
    def network_file(self) -> Path:
        """The SUMO network in the world's folder.

        Raises:
            PaveTwinError: the world was never saved.
        """
        if self.folder is None:
            raise PaveTwinError(f"The world '{self.name}' has no folder yet; save it with `save_world` first.")
        return self.folder / "roads.net.xml"

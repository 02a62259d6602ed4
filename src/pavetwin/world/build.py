"""A world from a source: the road network, the segments, and the objects along the streets."""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field
from shapely import MultiPoint, MultiPolygon, Point, Polygon
from shapely.ops import nearest_points

from pavetwin.config.settings import NameOrFile, Settings
from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256, hint
from pavetwin.world.buildings import buildings_by_rule, clear_of_roads
from pavetwin.world.content import content_hash, snapped_world
from pavetwin.world.folder import NET_SUFFIXES, OSM_SUFFIXES
from pavetwin.world.furniture import furnish
from pavetwin.world.generate import NetworkKind, SourceNetwork, generate_network, with_parking_lanes
from pavetwin.world.georeference import DEFAULT_ANCHOR_DEG, GeoReference, anchored, from_location
from pavetwin.world.ground import PlacementGround
from pavetwin.world.model import Building, Lane, LaneKind, Segment, World
from pavetwin.world.network import LeftOut, network_from_net, network_from_osm, source_kind
from pavetwin.world.osm import MapFeatures, bridges_on, paving_m2, read_features, surfaces_in
from pavetwin.world.parking.lanes import EdgeLanes, insert_lanes, parking_lanes
from pavetwin.world.parking.places import parking_places
from pavetwin.world.parking.rule import ParkingRule, parking_rule
from pavetwin.world.roadnet import RoadNet, read_roadnet
from pavetwin.world.segments import (
    DEFAULT_SEGMENT_LENGTH_M,
    MIN_SEGMENT_LENGTH_M,
    StreetSurface,
    polygons_of,
    segments_of,
    streets_of,
    union_of,
)

SMALLEST_PARK_M2 = 20.0
"""A park's part below this is dropped [m²]."""

Progress = Callable[[str, float], None]
"""Called with the name of the step and the share done, 0 … 1."""


class BuildOptions(Settings):
    """Options of a world. The same source and options give the same bytes."""

    seed: Annotated[int, Field(ge=0)] = 0
    segment_length_m: Annotated[float, Field(ge=2 * MIN_SEGMENT_LENGTH_M, le=2000.0)] = DEFAULT_SEGMENT_LENGTH_M
    anchor: tuple[float, float] | None = None
    """(latitude, longitude) in degrees of the origin of a network without a location or with an unknown projection."""
    left_hand: bool = False
    """Traffic keeps left (OSM sources; a SUMO network states it itself)."""
    parking_rule: NameOrFile = "europe"
    """Sizes of parking places, what stays clear, and where vehicles park if the map has no tag for it: `europe`,
    `north_america`, a YAML file of the same form, or `none` for a world without parking places."""


class BuildRecord(Settings):
    """The source and options of a world; stored in its `world.yaml`."""

    source: str
    """The source file's name, or `generated town` and the like."""
    source_sha256: str = ""
    options: BuildOptions = BuildOptions()
    mapped: dict[str, int] = Field(default_factory=dict)
    """Numbers of buildings and of each kind of furniture from the source; the rest was placed by rule."""
    left_out: LeftOut = LeftOut()
    """Streets of the source that are not connected with the rest."""
    paving_m2: dict[str, float] = Field(default_factory=dict)
    """Area of segments [m²] whose street's `surface` in OSM is not asphalt, by its value; see `world.paving`."""
    defects: dict[str, Any] = Field(default_factory=dict)
    """Options by which the defects were placed."""


@dataclass(frozen=True)
class Built:
    """A world that is not saved yet, with its SUMO network."""

    world: World
    network: bytes
    record: BuildRecord


def build_world(
    source: str | Path | NetworkKind, options: BuildOptions | None = None, on_progress: Progress | None = None
) -> Built:
    """Build a world, without defects, from a map, a SUMO network, or a kind of generated network.

    A `Path`, or a string that names a file (`.osm`, `.osm.gz`, `.osm.pbf`, `.net.xml`), is read; a `NetworkKind` or
    its name is a kind to generate.

    Raises:
        PaveTwinError: the source is missing, damaged or without streets, an option does not fit, or SUMO is missing.
    """
    options = options or BuildOptions()
    report = on_progress or (lambda _what, _share: None)
    rule = parking_rule(options.parking_rule)
    try:
        with tempfile.TemporaryDirectory(prefix="pavetwin-") as folder:
            report("road network", 0.0)
            given = _file_or_kind(source)
            made, record = _prepare(given, options, Path(folder))
            osm_file = given if isinstance(given, Path) and source_kind(given) == "osm" else None
            net = read_roadnet(made.net_file, shown_as=record.source)
            georeference = made.georeference or _georeference(net, options, record.source)
            report("segments", 0.3)
            roads = _Roads.of(net, options, record.source)
            report("map", 0.35)
            features = MapFeatures()
            if osm_file is not None:
                near = MultiPolygon([part for segment in roads.segments for part in polygons_of(segment.polygon)])
                features = read_features(osm_file, georeference, near)
            layout = _Layout(made, roads, features, options.seed)
            if rule is not None and (made.georeference or osm_file):  # a network of the user's own stays as it is
                report("parking", 0.45)
                if lanes := layout.parking_lanes(rule):
                    report("parking lanes", 0.5)
                    made = _with_lanes(made, lanes, given, options, Path(folder) / "lanes", left_hand=net.left_hand)
                    wider = _Roads.of(read_roadnet(made.net_file, shown_as=record.source), options, record.source)
                    layout = replace(layout, made=made, roads=wider)
            network = made.net_file.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise PaveTwinError(
            f"Cannot build in the temporary folder '{tempfile.gettempdir()}': {reason}. "
            f"{hint(error, 'name another one in TMPDIR')}."
        ) from error
    world, mapped = _build(layout, georeference, rule, record.source, report)
    world = replace(world, content_hash=content_hash(world, hashlib.sha256(network).hexdigest()))
    report("world", 1.0)
    paving = paving_m2(world.segments, surfaces_in(osm_file)) if osm_file is not None else {}
    return Built(world, network, record.model_copy(update={"mapped": mapped, "paving_m2": paving}))


def _file_or_kind(source: str | Path | NetworkKind) -> str | Path | NetworkKind:
    if isinstance(source, Path | NetworkKind) or source in list(NetworkKind):
        return source
    named_so = source.lower().endswith((*OSM_SUFFIXES, *NET_SUFFIXES))
    return Path(source) if named_so or Path(source).is_file() else source


def _prepare(
    source: str | Path | NetworkKind, options: BuildOptions, folder: Path
) -> tuple[SourceNetwork, BuildRecord]:
    if not isinstance(source, Path):
        made = generate_network(source, options.seed, folder, anchor=options.anchor or DEFAULT_ANCHOR_DEG)
        return made, BuildRecord(source=f"generated {source!s}", options=options)
    target = folder / "roads.net.xml"
    if source_kind(source) == "osm":
        if options.anchor is not None:
            raise PaveTwinError(f"'{source}' states its own location; omit `anchor`.")
        lost = network_from_osm(source, target, left_hand=options.left_hand)
    else:
        lost = LeftOut()
        network_from_net(source, target)
    record = BuildRecord(source=source.name, source_sha256=file_sha256(source), options=options, left_out=lost)
    return SourceNetwork(target), record


@dataclass(frozen=True)
class _Roads:
    """A network with its streets and segments."""

    net: RoadNet
    streets: tuple[StreetSurface, ...]
    segments: tuple[Segment, ...]
    ground: PlacementGround

    @classmethod
    def of(cls, net: RoadNet, options: BuildOptions, source: str) -> Self:
        streets = streets_of(net)
        segments = segments_of(streets, options.segment_length_m)
        if not segments:
            raise PaveTwinError(f"'{source}' has no streets for passenger cars of at least 8 m.")
        return cls(net, streets, segments, PlacementGround(net))


@dataclass(frozen=True)
class _Layout:
    """Roads, and what lies next to them."""

    made: SourceNetwork
    roads: _Roads
    features: MapFeatures
    seed: int

    @cached_property
    def parks(self) -> tuple[Polygon, ...]:
        return _parks([*self.made.parks, *self.features.parks], self.roads.ground)

    @cached_property
    def buildings(self) -> tuple[Building, ...]:
        """Buildings of the source, cut back from the roads, or else those of the rule."""
        given = [(building.polygon, building.height_m) for building in self.made.buildings]
        given += self.features.buildings
        if given:
            return clear_of_roads(given, self.roads.ground)
        return buildings_by_rule(self.roads.segments, self.roads.ground, self.parks, self.seed)

    def parking_lanes(self, rule: ParkingRule) -> Mapping[str, EdgeLanes]:
        """The parking lanes that the network is to get, by edge."""
        roads, houses = self.roads, [building.polygon for building in self.buildings] if self.features.buildings else []
        return parking_lanes(
            roads.net, roads.streets, roads.segments, self.buildings, self.features.parking, rule, houses
        )


def _with_lanes(
    made: SourceNetwork,
    lanes: Mapping[str, EdgeLanes],
    source: str | Path | NetworkKind,
    options: BuildOptions,
    folder: Path,
    *,
    left_hand: bool,
) -> SourceNetwork:
    """The network with parking lanes, written into a new folder."""
    folder.mkdir()
    target = folder / "roads.net.xml"
    if not isinstance(source, Path):
        return with_parking_lanes(made, str(source), options.seed, lanes, target)
    insert_lanes(made.net_file, lanes, target, left_hand=left_hand)
    return replace(made, net_file=target)


def _build(
    layout: _Layout, georeference: GeoReference, rule: ParkingRule | None, source: str, report: Progress
) -> tuple[World, dict[str, int]]:
    """The world without its content hash, and how many objects of each kind came from the source."""
    made, features, buildings = layout.made, layout.features, layout.buildings
    net, streets, segments = layout.roads.net, layout.roads.streets, layout.roads.segments
    mapped = Counter(buildings=len(buildings) if made.buildings or features.buildings else 0)
    report("furniture", 0.8)
    planted = layout.parks if made.parks else ()
    furniture, of_map = furnish(
        net, streets, segments, layout.roads.ground, buildings, features.points, planted, layout.seed
    )
    mapped.update({kind.value: count for kind, count in of_map.items()})
    report("parking", 0.9)
    parking = (
        parking_places(net, streets, segments, buildings, furniture, features.parking, rule) if rule is not None else ()
    )
    report("world", 0.95)
    world = snapped_world(
        World(
            name=Path(source).name.split(".")[0],
            georeference=georeference,
            left_hand=net.left_hand,
            streets=tuple(
                replace(
                    surface.street,
                    latin_name=features.latin_names.get(surface.street.name, ""),
                    bridges=bridges_on(surface.street.centre_line, features.bridges),
                )
                for surface in streets
            ),
            segments=segments,
            lanes=_lanes(net),
            connections=net.connections,
            junctions=net.junctions,
            crossings=net.crossings,
            buildings=buildings,
            furniture=furniture,
            parks=layout.parks,
            defects=(),
            base=base_of(segments),
            parking=parking,
        )
    )
    return world, dict(sorted(mapped.items()))


def _georeference(net: RoadNet, options: BuildOptions, shown: str) -> GeoReference:
    if options.anchor is not None:
        return anchored(*options.anchor)
    return from_location(net.location, shown) or anchored(*DEFAULT_ANCHOR_DEG)


def _lanes(net: RoadNet) -> tuple[Lane, ...]:
    """All lanes by edge and position; sidewalks last."""
    lanes = [lane for edge in net.edges.values() for lane in edge.lanes]
    return tuple(sorted(lanes, key=lambda lane: lane.kind is LaneKind.SIDEWALK))


def _parks(given: Iterable[Polygon], ground: PlacementGround) -> tuple[Polygon, ...]:
    parks: list[Polygon] = []
    for park in given:
        roads = ground.roads_near(park, 0.0)
        rest = park.difference(union_of(roads, 0.01)) if roads else park
        parks += [part for part in polygons_of(rest) if part.area >= SMALLEST_PARK_M2]
    return tuple(parks)


def base_of(segments: Sequence[Segment]) -> Point:
    """The place on a street nearest to the middle of all segments: where the UAV takes off by default."""
    middle = MultiPoint([segment.centre_line.centroid for segment in segments]).centroid
    nearest = min(segments, key=lambda segment: segment.centre_line.distance(middle))
    on_street, _ = nearest_points(nearest.centre_line, middle)
    return Point(on_street.x, on_street.y)

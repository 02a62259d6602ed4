"""DJI's `.kmz` with WPML (Waypoint Markup Language 1.0.2): `wpmz/template.kml`, which DJI Pilot 2 edits, and
`wpmz/waylines.wpml`, which the aircraft flies.

Elements, their order and their values are those of "DJI WPML" in DJI's Cloud API documentation.
"""

import io
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.flightplan.flight_plan import STRAIGHT_DOWN_DEG, FlightPlan, PlannedFlight, Trigger, Waypoint
from pavetwin.flightplan.formats.plan_files import PlanFormat, number_text, plan_format

KML: Final = "http://www.opengis.net/kml/2.2"
WPML: Final = "http://www.dji.com/wpmz/1.0.2"

OF_KML: Final = frozenset({"Document", "Folder", "Placemark", "Point", "coordinates"})
"""Elements of KML; all others are WPML's."""

Node = tuple[str, "str | Sequence[Node]"]
"""An element: its name, and its text or its elements."""


@dataclass(frozen=True, slots=True)
class Drone:
    """An aircraft in DJI's numbers (`droneInfo`, `payloadInfo`)."""

    number: int
    sub_number: int
    camera: int
    camera_sub_number: int
    lens: str
    """`payloadLensIndex` of photographs."""


DRONES: Final = {
    "mavic3e": Drone(77, 0, 66, 0, "wide"),
    "matrice30": Drone(67, 0, 52, 0, "wide"),
    "matrice350": Drone(89, 0, 50, 1, "visable"),
}
"""Keyed by the names of aircraft profiles: Mavic 3 Enterprise, Matrice 30, Matrice 350 RTK with Zenmuse P1 and its 35
mm lens (`visable` is DJI's spelling)."""

LOWEST_TAKE_OFF_M: Final = 1.2
"""Least `takeOffSecurityHeight` of DJI's plans."""

SPEEDS_MPS: Final = (1.0, 15.0)
"""DJI's range of `waypointSpeed`, `autoFlightSpeed` and `globalTransitionalSpeed`."""


@plan_format("wpml")
class Wpml(PlanFormat):
    """DJI's `.kmz`."""

    suffix = ".kmz"

    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        drone = drone_named(self.drone or plan.aircraft)
        _check_speeds(flight)
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, nodes in (("template.kml", _template), ("waylines.wpml", _waylines)):
                entry = zipfile.ZipInfo(f"wpmz/{name}")  # of 1980, so that equal plans are equal bytes
                entry.external_attr = 0o600 << 16
                archive.writestr(entry, _xml(nodes(plan, flight, drone)), zipfile.ZIP_DEFLATED)
        return file.getvalue()


def drone_named(name: str | None) -> Drone:
    """An aircraft for DJI's plans.

    Raises:
        PaveTwinError: the drone is unknown.
    """
    if name not in DRONES:
        raise PaveTwinError(no_such("drone of DJI's plans", name or "none", DRONES, key="`drone`"))
    return DRONES[name]


def _check_speeds(flight: PlannedFlight) -> None:
    least, most = SPEEDS_MPS
    for each in flight.waypoints:
        if not least <= each.speed_mps <= most:
            setting = "uav.inspect_speed_mps" if each.photographs else "uav.transit_speed_mps"
            raise PaveTwinError(
                f"`{setting}` {each.speed_mps:g}: DJI's plans hold speeds of {least:g} to {most:g} m/s; fly the "
                "mission again with such a speed, or choose another format."
            )


def _template(plan: FlightPlan, flight: PlannedFlight, drone: Drone) -> Sequence[Node]:
    created_ms = str(max(0, round(1000 * plan.flown_at.timestamp())))
    height, speed = number_text(flight.home.height_m), number_text(flight.home.speed_mps)
    folder: list[Node] = [
        ("templateType", "waypoint"),
        ("templateId", "0"),
        (
            "waylineCoordinateSysParam",
            [("coordinateMode", "WGS84"), ("heightMode", "relativeToStartPoint"), ("positioningType", "GPS")],
        ),
        ("autoFlightSpeed", speed),
        ("globalHeight", height),
        ("gimbalPitchMode", "usePointSetting"),
        ("globalWaypointHeadingParam", _heading()),
        ("globalWaypointTurnMode", "toPointAndStopWithDiscontinuityCurvature"),
        ("globalUseStraightLine", "1"),
    ]
    for number, each in enumerate(flight.waypoints):
        height = number_text(each.height_m)
        folder.append(
            (
                "Placemark",
                [
                    ("Point", [("coordinates", _coordinates(each))]),
                    ("index", str(number)),
                    ("ellipsoidHeight", height),
                    ("height", height),
                    ("useGlobalHeight", "0"),
                    ("useGlobalSpeed", "0"),
                    ("waypointSpeed", number_text(each.speed_mps)),
                    ("useGlobalHeadingParam", "1"),
                    ("useGlobalTurnParam", "0"),
                    ("waypointTurnParam", _turn(each)),
                    ("useStraightLine", "1"),
                    ("gimbalPitchAngle", number_text(STRAIGHT_DOWN_DEG)),
                    *_actions(plan, flight, number, drone),
                ],
            )
        )
    folder.append(("payloadParam", [("payloadPositionIndex", "0"), ("imageFormat", drone.lens)]))
    return [
        ("author", "PaveTwin"),
        ("createTime", created_ms),
        ("updateTime", created_ms),
        ("missionConfig", _configuration(flight, drone)),
        ("Folder", folder),
    ]


def _waylines(plan: FlightPlan, flight: PlannedFlight, drone: Drone) -> Sequence[Node]:
    folder: list[Node] = [
        ("templateId", "0"),
        ("executeHeightMode", "relativeToStartPoint"),
        ("waylineId", "0"),
        ("autoFlightSpeed", number_text(flight.home.speed_mps)),
    ]
    for number, each in enumerate(flight.waypoints):
        folder.append(
            (
                "Placemark",
                [
                    ("Point", [("coordinates", _coordinates(each))]),
                    ("index", str(number)),
                    ("executeHeight", number_text(each.height_m)),
                    ("waypointSpeed", number_text(each.speed_mps)),
                    ("waypointHeadingParam", _heading()),
                    ("waypointTurnParam", _turn(each)),
                    ("useStraightLine", "1"),
                    *_actions(plan, flight, number, drone),
                ],
            )
        )
    return [("missionConfig", _configuration(flight, drone)), ("Folder", folder)]


def _configuration(flight: PlannedFlight, drone: Drone) -> Sequence[Node]:
    """Mission settings. The aircraft lands where the path ends, above the take-off point: `goHome` would fly there
    straight, at another height."""
    return [
        ("flyToWaylineMode", "safely"),
        ("finishAction", "autoLand"),
        ("exitOnRCLost", "executeLostAction"),
        ("executeRCLostAction", "goBack"),
        ("takeOffSecurityHeight", number_text(max(LOWEST_TAKE_OFF_M, flight.home.height_m))),
        ("globalTransitionalSpeed", number_text(max(each.speed_mps for each in flight.waypoints))),
        ("droneInfo", [("droneEnumValue", str(drone.number)), ("droneSubEnumValue", str(drone.sub_number))]),
        (
            "payloadInfo",
            [
                ("payloadEnumValue", str(drone.camera)),
                ("payloadSubEnumValue", str(drone.camera_sub_number)),
                ("payloadPositionIndex", "0"),
            ],
        ),
    ]


def _heading() -> Sequence[Node]:
    return [
        ("waypointHeadingMode", "followWayline"),
        ("waypointHeadingAngle", "0"),
        ("waypointPoiPoint", "0.000000,0.000000,0.000000"),
        ("waypointHeadingPathMode", "followBadArc"),
    ]


def _turn(waypoint: Waypoint) -> Sequence[Node]:
    mode = "toPointAndPassWithContinuityCurvature" if waypoint.corner_m else "toPointAndStopWithDiscontinuityCurvature"
    return [("waypointTurnMode", mode), ("waypointTurnDampingDist", number_text(waypoint.corner_m))]


def _coordinates(waypoint: Waypoint) -> str:
    return f"{waypoint.longitude:.8f},{waypoint.latitude:.8f}"


def _actions(plan: FlightPlan, flight: PlannedFlight, number: int, drone: Drone) -> Iterator[Node]:
    """Action groups that begin at a waypoint: the camera turned down at the first, photographs over a photographed
    stretch."""
    waypoints = flight.waypoints
    if number == 0:
        turn: list[Node] = [
            *(("gimbalHeadingYawBase", "aircraft"), ("gimbalRotateMode", "absoluteAngle")),
            *(("gimbalPitchRotateEnable", "1"), ("gimbalPitchRotateAngle", number_text(STRAIGHT_DOWN_DEG))),
            *(("gimbalRollRotateEnable", "0"), ("gimbalRollRotateAngle", "0")),
            *(("gimbalYawRotateEnable", "0"), ("gimbalYawRotateAngle", "0")),
            *(("gimbalRotateTimeEnable", "0"), ("gimbalRotateTime", "0"), ("payloadPositionIndex", "0")),
        ]
        yield _group(0, 0, 0, [("actionTriggerType", "reachPoint")], "gimbalRotate", turn)
    if not waypoints[number].photographs or (number > 0 and waypoints[number - 1].photographs):
        return
    end = next((i for i in range(number, len(waypoints)) if not waypoints[i].photographs), len(waypoints) - 1)
    by_distance = plan.trigger is Trigger.DISTANCE
    every = number_text(round(plan.spacing_m if by_distance else plan.interval_s, 3))
    when: list[Node] = [
        ("actionTriggerType", "multipleDistance" if by_distance else "multipleTiming"),
        ("actionTriggerParam", every),
    ]
    photograph: list[Node] = [
        ("payloadPositionIndex", "0"),
        ("fileSuffix", waypoints[number].segment or ""),
        ("payloadLensIndex", drone.lens),
        ("useGlobalPayloadLensIndex", "0"),
    ]
    yield _group(number + 1, number, end, when, "takePhoto", photograph)


def _group(
    number: int, first: int, last: int, trigger: Sequence[Node], action: str, parameters: Sequence[Node]
) -> Node:
    return (
        "actionGroup",
        [
            ("actionGroupId", str(number)),
            ("actionGroupStartIndex", str(first)),
            ("actionGroupEndIndex", str(last)),
            ("actionGroupMode", "sequence"),
            ("actionTrigger", trigger),
            (
                "action",
                [("actionId", "0"), ("actionActuatorFunc", action), ("actionActuatorFuncParam", parameters)],
            ),
        ],
    )


def _xml(document: Sequence[Node]) -> bytes:
    ElementTree.register_namespace("wpml", WPML)
    root = ElementTree.Element(f"{{{KML}}}kml")
    _add(root, ("Document", document))
    ElementTree.indent(root)
    file = io.BytesIO()
    ElementTree.ElementTree(root).write(file, encoding="UTF-8", xml_declaration=True, default_namespace=KML)
    return file.getvalue()


def _add(parent: ElementTree.Element, node: Node) -> None:
    name, content = node
    tag = f"{{{KML if name in OF_KML else WPML}}}{name}"
    element = ElementTree.SubElement(parent, tag)
    if isinstance(content, str):
        element.text = content
    else:
        for each in content:
            _add(element, each)

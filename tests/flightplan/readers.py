"""Readers of plans, written from the published structure of each format, without what writes them."""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Final, Literal, NamedTuple
from xml.etree import ElementTree

from pydantic import BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel


class Read(NamedTuple):
    """A waypoint as a file gives it."""

    longitude: float
    latitude: float
    height_m: float
    speed_mps: float
    photographs: bool
    """On the leg that begins there."""
    every: float | None
    """Metres or seconds between photographs."""
    stops: bool
    """True where the aircraft stops."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, alias_generator=to_camel)


Number = int | float


class Simple(_Strict):
    """ "SimpleItem" of QGroundControl's "Plan File Format"."""

    type: Literal["SimpleItem"]
    auto_continue: bool
    command: int
    do_jump_id: Annotated[int, Field(ge=1)]
    frame: Literal[0, 2, 3]
    params: Annotated[list[Number | None], Field(min_length=7, max_length=7)]
    above_terrain: Annotated[Number | None, Field(alias="AMSLAltAboveTerrain")] = None
    altitude: Annotated[Number | None, Field(alias="Altitude")] = None
    altitude_mode: Annotated[Literal[0, 1, 2, 3] | None, Field(alias="AltitudeMode")] = None


class Mission(_Strict):
    version: Literal[2]
    firmware_type: int
    vehicle_type: int
    cruise_speed: Number
    hover_speed: Number
    planned_home_position: Annotated[list[Number], Field(min_length=3, max_length=3)]
    items: list[Simple]


class GeoFence(_Strict):
    version: Literal[2]
    circles: list[Any]
    polygons: list[Any]


class RallyPoints(_Strict):
    version: Literal[2]
    points: list[Any]


class Plan(_Strict):
    file_type: Literal["Plan"]
    version: Literal[1]
    ground_station: str
    mission: Mission
    geo_fence: GeoFence
    rally_points: RallyPoints


def read_qgc(content: bytes) -> list[Read]:
    """Executes the commands in their order, as an autopilot does."""
    items = Plan.model_validate(json.loads(content)).mission.items
    assert [each.do_jump_id for each in items] == list(range(1, len(items) + 1))
    assert items[0].command == 22, "it takes off first"
    assert items[-1].command == 21, "it lands last"
    assert any(each.command == 205 and each.params[0] == -90 for each in items), "the camera is turned down"
    found: list[Read] = []
    speed, every = 0.0, None
    for each in items:
        values = [float(value or 0) for value in each.params]
        if each.command == 16:
            assert each.frame == 3
            assert values[0] in (0, 1)
            found.append(Read(values[5], values[4], values[6], speed, every is not None, every, values[0] == 1))
        elif each.command == 178:
            speed = values[1]
        elif each.command == 206:
            every = values[0] or None
        elif each.command in (2000, 2001):
            every = values[1] if each.command == 2000 else None
        if found:
            found[-1] = found[-1]._replace(speed_mps=speed, photographs=every is not None, every=every)
    return found


K, W = "{http://www.opengis.net/kml/2.2}", "{http://www.dji.com/wpmz/1.0.2}"

CONFIGURATION: Final = (
    *("flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight"),
    *("globalTransitionalSpeed", "droneInfo", "payloadInfo"),
)
TEMPLATE_FOLDER: Final = (
    *("templateType", "templateId", "waylineCoordinateSysParam", "autoFlightSpeed", "globalHeight"),
    *("gimbalPitchMode", "globalWaypointHeadingParam", "globalWaypointTurnMode", "globalUseStraightLine"),
)
TEMPLATE_POINT: Final = (
    *("index", "ellipsoidHeight", "height", "useGlobalHeight", "useGlobalSpeed", "waypointSpeed"),
    *("useGlobalHeadingParam", "useGlobalTurnParam", "waypointTurnParam", "useStraightLine", "gimbalPitchAngle"),
)
WAYLINE_FOLDER: Final = ("templateId", "executeHeightMode", "waylineId", "autoFlightSpeed")
WAYLINE_POINT: Final = (
    *("index", "executeHeight", "waypointSpeed", "waypointHeadingParam", "waypointTurnParam", "useStraightLine"),
)
GROUP: Final = (
    *("actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode", "actionTrigger", "action"),
)


def read_wpml(content: bytes) -> list[Read]:
    archive = zipfile.ZipFile(io.BytesIO(content))
    assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
    template, waylines = (_document(archive.read(name)) for name in archive.namelist())
    (lines,) = waylines.findall(f"{K}Folder")
    (edited,) = template.findall(f"{K}Folder")
    assert _names(template) == ["author", "createTime", "updateTime", "missionConfig", "Folder"]
    assert _names(waylines) == ["missionConfig", "Folder"]
    for document in (template, waylines):
        assert _names(document.find(f"{W}missionConfig")) == list(CONFIGURATION)
    assert [name for name in _names(edited) if name != "Placemark"] == [*TEMPLATE_FOLDER, "payloadParam"]
    assert [name for name in _names(lines) if name != "Placemark"] == list(WAYLINE_FOLDER)
    assert lines.findtext(f"{W}executeHeightMode") == "relativeToStartPoint"
    assert edited.findtext(f"{W}waylineCoordinateSysParam/{W}heightMode") == "relativeToStartPoint"
    points = _points(lines, WAYLINE_POINT, "executeHeight")
    assert points == _points(edited, TEMPLATE_POINT, "height"), "what is edited is what is flown"
    return points


def _document(content: bytes) -> ElementTree.Element:
    root = ElementTree.fromstring(content)
    assert root.tag == f"{K}kml"
    (document,) = root
    assert document.tag == f"{K}Document"
    return document


def _points(folder: ElementTree.Element, names: Sequence[str], height: str) -> list[Read]:
    placemarks = folder.findall(f"{K}Placemark")
    photographed: dict[int, float] = {}
    found = []
    for number, each in enumerate(placemarks):
        groups = each.findall(f"{W}actionGroup")
        assert _names(each) == ["Point", *names, *["actionGroup"] * len(groups)]
        assert each.findtext(f"{W}index") == str(number)
        for group in groups:
            assert _names(group) == list(GROUP)
            first, last = (int(group.findtext(f"{W}actionGroup{end}Index") or "") for end in ("Start", "End"))
            assert number == first <= last < len(placemarks)
            kind = group.findtext(f"{W}actionTrigger/{W}actionTriggerType")
            action = group.findtext(f"{W}action/{W}actionActuatorFunc")
            assert (kind == "reachPoint") == (action == "gimbalRotate")
            if action == "takePhoto":
                every = float(group.findtext(f"{W}actionTrigger/{W}actionTriggerParam") or "")
                photographed |= dict.fromkeys(range(first, last), every)
        longitude, latitude = map(float, (each.findtext(f"{K}Point/{K}coordinates") or "").split(","))
        height_m, speed = (float(each.findtext(f"{W}{name}") or "") for name in (height, "waypointSpeed"))
        every_there = photographed.get(number)
        stops = "Stop" in (each.findtext(f"{W}waypointTurnParam/{W}waypointTurnMode") or "")
        found.append(Read(longitude, latitude, height_m, speed, every_there is not None, every_there, stops))
    assert folder.find(f".//{W}gimbalPitchRotateAngle").text == "-90"  # type: ignore[union-attr]
    return found


def _names(element: ElementTree.Element | None) -> list[str]:
    assert element is not None
    return [each.tag.partition("}")[2] for each in element]


def read_litchi(content: bytes) -> list[Read]:
    rows = _rows(content)
    assert len(rows) <= 99
    assert {len(row) for row in rows} == {46}
    assert (rows[0]["actiontype1"], rows[0]["actionparam1"]) == ("5", "-90")
    found = []
    for row in rows:
        assert (row["altitudemode"], row["gimbalmode"], row["gimbalpitchangle"]) == ("0", "2", "-90")
        assert 0 <= float(row["heading(deg)"]) <= 360
        every = max(float(row["photo_timeinterval"]), float(row["photo_distinterval"]))
        place = (float(row["longitude"]), float(row["latitude"]), float(row["altitude(m)"]))
        stops = float(row["curvesize(m)"]) == 0
        found.append(Read(*place, float(row["speed(m/s)"]), every > 0, every if every > 0 else None, stops))
    return found


def read_csv(content: bytes) -> list[Read]:
    found = []
    for row in _rows(content):
        every = row.get("every_m") or row.get("every_s") or None
        assert (row["photographs"] == "yes") == (every is not None)
        place = (float(row["longitude"]), float(row["latitude"]), float(row["height_m"]))
        stops = row["corner_m"] == "0"
        found.append(Read(*place, float(row["speed_mps"]), every is not None, float(every) if every else None, stops))
    return found


def _rows(content: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(content.decode())))


READERS: Final[Mapping[str, Callable[[bytes], list[Read]]]] = {
    "qgc": read_qgc,
    "wpml": read_wpml,
    "litchi": read_litchi,
    "csv": read_csv,
}

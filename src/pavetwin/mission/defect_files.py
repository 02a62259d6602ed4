"""The defects of a mission as files: `captures.geojson` (those found), `defects.gpkg` and `defects.csv` (all)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

from pavetwin.files import writing
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.inspected_defects import HIDDEN, InspectedDefect
from pavetwin.world.layers import columns_of, write_layer
from pavetwin.world.model import Defect, World

_COLUMNS: dict[str, Any] = {
    **{"id": pl.Int64, "class": pl.String, "severity": pl.String},
    **dict.fromkeys(("width_m", "depth_m", "length_m", "area_m2", "volume_m3"), pl.Float64),
    **{"segment": pl.String, "street": pl.String, "outcome": pl.String, "reason": pl.String},
    **{"policy_response": pl.String, "captures": pl.Int64, "captures_on_revisit": pl.Int64},
    **{"capture": pl.Int64, "time_s": pl.Float64, "on_revisit": pl.Boolean, "visible_fraction": pl.Float64},
    **dict.fromkeys((reason.value for reason in HIDDEN), pl.Float64),
    **{"longitude": pl.Float64, "latitude": pl.Float64},
}
"""Of `defects.csv` and of the layer `defects`; docs/reference/files.md explains them."""


def described(defect: Defect, world: World) -> dict[str, Any]:
    """What a defect is and where: the properties that all files of a mission give it."""
    return {
        "id": defect.id,
        "class": defect.kind,
        "severity": defect.severity.value,
        "width_m": round(defect.width_m, 4),
        "depth_m": round(defect.depth_m, 4),
        "length_m": round(defect.length_m, 4),
        "area_m2": round(defect.area_m2, 4),
        "volume_m3": round(defect.volume_m3, 7),
        "segment": defect.segment,
        "street": world.segment(defect.segment).street_name,
    }


def defects_table(result: MissionResult) -> pl.DataFrame:
    """One row a defect of the inspected segments: what it is, whether it was found, and if not, why."""
    rows = [_row(outcome, result.environment.world) for outcome in result.inspected_defects]
    return pl.DataFrame(rows, schema=_COLUMNS)


def _row(outcome: InspectedDefect, world: World) -> dict[str, Any]:
    defect, hidden_by = outcome.defect, outcome.hidden_by or {}
    lon, lat = world.georeference.to_wgs84((defect.centre.x, defect.centre.y))
    return {
        **described(defect, world),
        "outcome": "found" if outcome.is_found else "missed",
        "reason": outcome.reason and outcome.reason.value,
        "policy_response": " ".join(response.value for response in outcome.responses) or None,
        "captures": outcome.captures,
        "captures_on_revisit": outcome.captures_on_revisit,
        "capture": outcome.capture,
        "time_s": _rounded(outcome.time_s, 3),
        "on_revisit": outcome.on_revisit,
        "visible_fraction": _rounded(outcome.visible_fraction, 4),
        **{reason.value: _rounded(hidden_by.get(reason), 4) for reason in HIDDEN},
        "longitude": round(float(lon), 8),
        "latitude": round(float(lat), 8),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def write_defects(result: MissionResult, folder: Path) -> None:
    """Write `defects.csv`, and `defects.gpkg` with the outlines in the world's coordinate system.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    table, environment = defects_table(result), result.environment
    table.write_csv(folder / "defects.csv")
    columns, masks = columns_of(table)
    outlines = [environment.defects[number].polygon for number in table["id"]]
    place = environment.world.georeference
    write_layer(folder / "defects.gpkg", "defects", "Polygon", outlines, columns, place, masks)


def write_captures(result: MissionResult, path: Path, frames: Sequence[str] = ()) -> None:
    """Write `captures.geojson`, see `detections_geojson`."""
    with writing(path) as temporary:
        temporary.write_text(json.dumps(detections_geojson(result, frames), indent=1) + "\n", encoding="utf-8")


def detections_geojson(result: MissionResult, frames: Sequence[str] = ()) -> dict[str, Any]:
    """The confirmed defects as points in WGS 84 (RFC 7946), each with the capture that confirmed it.

    Args:
        frames: for each detection, the file of its frame, where frames were taken.
    """
    world = result.environment.world
    features = []
    for number, detection in enumerate(result.confirmed):
        assert detection.defect is not None
        assert detection.visible_fraction is not None
        defect = result.environment.defects[detection.defect]
        lon, lat = world.georeference.to_wgs84((defect.centre.x, defect.centre.y))
        camera_lon, camera_lat = world.georeference.to_wgs84(detection.position)
        features.append(
            {
                "type": "Feature",
                "id": defect.id,
                "geometry": {"type": "Point", "coordinates": [round(float(lon), 8), round(float(lat), 8)]},
                "properties": {
                    **described(defect, world),
                    "capture": detection.capture,
                    "time_s": round(detection.time_s, 3),
                    "on_revisit": detection.on_revisit,
                    "attempt": detection.attempt,
                    "visible_fraction": round(detection.visible_fraction, 4),
                    "camera_longitude": round(float(camera_lon), 8),
                    "camera_latitude": round(float(camera_lat), 8),
                    "camera_altitude_m": result.settings.altitude_m,
                    "camera_yaw_rad": round(detection.yaw_rad, 6),
                    **({"frame": frames[number]} if frames else {}),
                },
            }
        )
    return {"type": "FeatureCollection", "features": features}

"""Files of a mission's folder: segments, streets, defects, detections, looks, the track, and the description."""

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import pyarrow.parquet
import shapely
import yaml

from pavetwin.arrays import Float64Array
from pavetwin.detections import SIZES, Outcome
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing, writing_folder
from pavetwin.mission.inspected_defects import HIDDEN, InspectedDefect, MissReason, captured_frame
from pavetwin.mission.metrics import SegmentMetrics, totals
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import MODES
from pavetwin.sensing.fit.look_tables import LOOK_SCHEMA, POSE_SCHEMA
from pavetwin.sensing.frame import LookMeter
from pavetwin.world.layers import columns_of, write_layer
from pavetwin.world.model import Defect, World

MISSION: Final = "mission.yaml"
SEGMENTS: Final = "mission.parquet"
TRACK: Final = "track.parquet"
DETECTIONS: Final = "detections.parquet"
LOOKS: Final = "looks.parquet"
CAPTURES: Final = "captures.geojson"
DEFECTS: Final = "defects.csv"
STREETS: Final = "streets.csv"

TOTALS: Final = "totals"
"""The key of `mission.yaml` next to those of the spec."""

_DEFECT_COLUMNS: dict[str, Any] = {
    **{"id": pl.Int64, "class": pl.String, "severity": pl.String},
    **dict.fromkeys(("width_m", "depth_m", "length_m", "area_m2", "volume_m3"), pl.Float64),
    **{"segment": pl.String, "street": pl.String, "outcome": pl.String, "reason": pl.String},
    **{"policy_response": pl.String, "captures": pl.Int64, "captures_on_revisit": pl.Int64},
    **{"capture": pl.Int64, "time_s": pl.Float64, "on_revisit": pl.Boolean, "visible_fraction": pl.Float64},
    **dict.fromkeys((reason.value for reason in HIDDEN), pl.Float64),
    **{"longitude": pl.Float64, "latitude": pl.Float64},
}
"""Columns of `defects.csv` and of the layer `defects`, described in docs/reference/files.md."""

DETECTION_COLUMNS: Final[Mapping[str, Any]] = {
    "time_s": pl.Float64,
    "capture": pl.Int64,
    "segment": pl.String,
    "outcome": pl.String,
    "class": pl.String,
    "confidence": pl.Float64,
    "defect": pl.Int64,
    "visible_fraction": pl.Float64,
    "on_revisit": pl.Boolean,
    "longitude": pl.Float64,
    "latitude": pl.Float64,
    **dict.fromkeys(SIZES, pl.Float64),
    "severity": pl.String,
    "pixel_mm": pl.Float64,
    "is_cut": pl.Boolean,
    "footprint": pl.Binary,
}
"""Columns of `detections.parquet`."""


def described(defect: Defect, world: World) -> dict[str, Any]:
    """Properties of a defect in all files of a mission."""
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
    """Table of the inspected segments' defects: one row per defect, found or missed and why."""
    rows = [_defect_row(outcome, result.environment.world) for outcome in result.inspected_defects]
    return pl.DataFrame(rows, schema=_DEFECT_COLUMNS)


def _defect_row(outcome: InspectedDefect, world: World) -> dict[str, Any]:
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
    table.write_csv(folder / DEFECTS)
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
        frames: the image of each confirmed defect, if images were saved.
    """
    world, found = result.environment.world, result.confirmed
    features = []
    for row, number in enumerate(found.defect.tolist()):
        defect, frame = result.environment.defects[number], result.log.frames[int(found.capture[row])]
        lon, lat = world.georeference.to_wgs84((defect.centre.x, defect.centre.y))
        camera_lon, camera_lat = world.georeference.to_wgs84(frame.position)
        features.append(
            {
                "type": "Feature",
                "id": defect.id,
                "geometry": {"type": "Point", "coordinates": [round(float(lon), 8), round(float(lat), 8)]},
                "properties": {
                    **described(defect, world),
                    "capture": frame.number,
                    "time_s": round(frame.time_s, 3),
                    "on_revisit": bool(found.on_revisit[row]),
                    "attempt": int(found.attempt[row]),
                    "visible_fraction": round(float(found.visible_fraction[row]), 4),
                    "camera_longitude": round(float(camera_lon), 8),
                    "camera_latitude": round(float(camera_lat), 8),
                    "camera_altitude_m": result.settings.altitude_m,
                    "camera_yaw_rad": round(frame.yaw_rad, 6),
                    **({"frame": frames[row]} if frames else {}),
                },
            }
        )
    return {"type": "FeatureCollection", "features": features}


def look_table(result: MissionResult) -> pl.DataFrame:
    """Table of looks: the columns of `LOOK_SCHEMA` and `POSE_SCHEMA`, in the order of captures.

    One row for each defect that a capture saw, and one with `defect` null for a capture that saw none. A capture sees
    a defect if enough of it is visible and its centre is in the inspection window.

    Raises:
        ValueError: the mission's sensor looks at no images.
    """
    if result.looked_px is None:
        raise ValueError("a sensor without images has no looks")
    meter, environment = LookMeter(result.looked_px), result.environment
    right = (Outcome.CONFIRMED, Outcome.DUPLICATE)
    matched = result.detections[[outcome in right for outcome in result.detections.outcome]]
    found = set(zip(matched.capture.tolist(), matched.defect.tolist(), strict=True))
    seen: dict[int, list[tuple[int, float]]] = {}
    for capture, defect, fraction in result.sighted:
        seen.setdefault(capture, []).append((defect, fraction))
    rows: list[dict[str, object]] = []
    for capture in range(len(result.captures["t_s"])):
        frame = captured_frame(result, capture)
        image: dict[str, object] = {
            "capture": capture,
            "image_px": min(result.looked_px, max(frame.camera.image_px)),
            "area_m2": float(frame.footprint.area),
            "pixel_mm": 1000.0 * meter.pixel_m(frame),
            "t_s": frame.time_s,
            "x_m": frame.position[0],
            "y_m": frame.position[1],
            "yaw_rad": frame.yaw_rad,
        }
        for defect, fraction in seen.get(capture, ()):
            look = meter.look(frame, environment.sighting(defect, fraction, 0))
            rows.append({**image, "defect": defect, "found": (capture, defect) in found, **look._asdict()})
        if capture not in seen:
            rows.append(image)
    return pl.DataFrame(rows, schema={**LOOK_SCHEMA, **POSE_SCHEMA})


def street_table(result: MissionResult, reasons: pl.DataFrame) -> pl.DataFrame:
    """Table of streets, one row per street, in the order of inspection.

    Columns: `policy`, `street`, `segments` (ids), `length_m`, `area_m2`, `defects`, `found`, `coverage` (share of the
    defects), `surface_coverage` (by area), `hidden`, `not_recognised`, `other_missed`, `time_s`,
    `pci` and `pci_found` (of the segments, by area).

    Args:
        reasons: `segment` and `reason` of each inspected defect, as in `defects.csv`; null if it was found.
    """
    grouped: dict[str, list[SegmentMetrics]] = {}
    for row in result.rows:
        grouped.setdefault(row.street, []).append(row)
    missed: dict[str, list[str]] = {}
    for segment, reason in reasons.select("segment", "reason").rows():
        if reason:
            missed.setdefault(segment, []).append(reason)
    return pl.DataFrame(
        [{"policy": result.policy, **_street_row(name, rows, missed)} for name, rows in grouped.items()],
        infer_schema_length=None,
    )


def _street_row(name: str, rows: Sequence[SegmentMetrics], missed: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    reasons = [reason for row in rows for reason in missed.get(row.segment, ())]
    hidden, unseen = sum(reason in HIDDEN for reason in reasons), reasons.count(MissReason.NOT_RECOGNISED)
    area_m2, defects = sum(row.area_m2 for row in rows), sum(row.defects for row in rows)
    found = sum(row.confirmed for row in rows)
    return {
        "street": name,
        "segments": " ".join(row.segment for row in rows),
        "length_m": round(sum(row.length_m for row in rows), 1),
        "area_m2": round(area_m2, 1),
        "defects": defects,
        "found": found,
        "coverage": round(found / defects, 4) if defects else None,
        "surface_coverage": round(sum(row.surface_coverage * row.area_m2 for row in rows) / area_m2, 4),
        "hidden": hidden,
        "not_recognised": unseen,
        "other_missed": len(reasons) - hidden - unseen,
        "time_s": round(sum(row.time_s for row in rows), 1),
        "pci": round(sum(row.pci * row.area_m2 for row in rows) / area_m2, 1),
        "pci_found": round(sum(row.pci_found * row.area_m2 for row in rows) / area_m2, 1),
    }


_TEXTS = {"segment": pl.String, "reason": pl.String}

_MODE_NAMES = [mode.value for mode in MODES]


def segment_table(result: MissionResult) -> pl.DataFrame:
    """Table of segments: the factors of the mission, then the metrics."""
    factors = {
        "world": result.environment.world.name,
        "traffic": result.traffic,
        "policy": result.policy,
        "sensor": result.sensor,
        "altitude_m": result.settings.altitude_m,
        "seed": result.seed,
    }
    return pl.DataFrame([factors | asdict(row) for row in result.rows], infer_schema_length=None)


def track_table(result: MissionResult) -> pl.DataFrame:
    """Time series of the UAV's state, a row every look interval, with its position in WGS 84."""
    track = result.track
    names = np.array([segment.id for segment in result.environment.world.segments] + [None], dtype=object)
    lonlat = result.environment.world.georeference.to_wgs84(np.column_stack([track["x_m"], track["y_m"]]))
    return pl.DataFrame(
        {
            **{"t_s": track["t_s"], "x_m": track["x_m"], "y_m": track["y_m"]},
            **{"longitude": lonlat[:, 0], "latitude": lonlat[:, 1], "altitude_m": track["altitude_m"]},
            **{"yaw_rad": track["yaw_rad"], "speed_mps": track["speed_mps"], "battery": track["battery"]},
            "mode": pl.Series([_MODE_NAMES[number] for number in track["mode"]], dtype=pl.Enum(_MODE_NAMES)),
            "segment": pl.Series(names[track["segment"]].tolist(), dtype=pl.String),
            "visibility": pl.Series(track["visibility"], nan_to_null=True),
        }
    )


def detections_table(result: MissionResult) -> pl.DataFrame:
    """A row for each detection with its outcome, false alarms included; places in WGS 84.

    Sizes are null where the sensor measures none or the image does not show them.
    """
    world, found = result.environment.world, result.detections
    to_wgs84, is_measured = world.georeference.to_wgs84, ~np.isnan(found.pixel_mm)
    lonlat = to_wgs84(shapely.get_coordinates(shapely.centroid(found.footprint)).reshape(-1, 2))
    names = [segment.id for segment in world.segments]
    columns = {
        "time_s": found.time_s,
        "capture": found.capture,
        "segment": [names[segment] for segment in found.segment],
        "outcome": [outcome.value for outcome in found.outcome],
        "class": found.class_name.tolist(),
        "confidence": found.confidence,
        "defect": [None if defect < 0 else defect for defect in found.defect.tolist()],
        "visible_fraction": _nullable(found.visible_fraction),
        "on_revisit": found.on_revisit,
        "longitude": lonlat[:, 0],
        "latitude": lonlat[:, 1],
        **{name: _nullable(getattr(found, name)) for name in SIZES},
        "severity": [severity or None for severity in found.severity],
        "pixel_mm": _nullable(found.pixel_mm),
        "is_cut": [cut if known else None for cut, known in zip(found.is_cut.tolist(), is_measured, strict=True)],
        "footprint": shapely.to_wkb(shapely.transform(found.footprint, to_wgs84)).tolist(),
    }
    return pl.DataFrame(columns, schema=DETECTION_COLUMNS)


def _nullable(values: Float64Array) -> pl.Series:
    return pl.Series(values, nan_to_null=True)


def description(result: MissionResult) -> dict[str, Any]:
    """Content of `mission.yaml`: the spec, from which the mission can be flown again, and the totals."""
    return {**result.spec.as_values(), TOTALS: asdict(totals(result))}


def save_mission(result: MissionResult, folder: Path | str) -> None:
    """Write a mission's files into `folder`, all or none, and replace an existing mission.

    Raises:
        PaveTwinError: the folder holds something else or cannot be written.
    """
    folder = Path(folder)
    check_mission_folder(folder)
    with writing_folder(folder, replace=True) as temporary:
        _write(result, temporary)


def save_missions(missions: Iterable[MissionResult], folder: Path) -> None:
    """Write several missions into one folder, each in a folder named by its policy.

    Each is written as soon as `missions` yields it, so an error in one loses none of those before.

    Raises:
        PaveTwinError: as `save_mission`.
    """
    check_mission_folder(folder)
    tables: list[pl.DataFrame] = []
    for result in missions:
        tables.append(segment_table(result))
        if len(tables) == 1:
            with writing_folder(folder, replace=True) as temporary:
                (temporary / result.policy).mkdir()
                _write(result, temporary / result.policy)
                _write_table(tables[0], temporary / SEGMENTS)
                shutil.copyfile(temporary / result.policy / STREETS, temporary / STREETS)
        else:
            with writing_folder(folder / result.policy, replace=True) as temporary:
                _write(result, temporary)
            with writing(folder / SEGMENTS) as path:
                _write_table(pl.concat(tables), path)
            streets = [folder / STREETS, folder / result.policy / STREETS]
            both = "".join(file.read_text(encoding="utf-8").partition("\n")[2] for file in streets)
            heads = streets[0].read_text(encoding="utf-8").partition("\n")[0]
            with writing(folder / STREETS) as path:
                path.write_text(f"{heads}\n{both}", encoding="utf-8")


def check_mission_folder(folder: Path) -> None:
    """Refuse to replace a folder that is not a mission.

    Raises:
        PaveTwinError: the folder exists, is not empty, and holds no mission.
    """
    if not folder.exists():
        return
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / SEGMENTS).is_file()):
        raise PaveTwinError(f"'{folder}' exists and holds no mission; choose another folder.")


def _write(result: MissionResult, folder: Path) -> None:
    _write_table(segment_table(result), folder / SEGMENTS)
    _write_table(track_table(result), folder / TRACK)
    _write_table(detections_table(result), folder / DETECTIONS)
    if result.looked_px is not None:
        _write_table(look_table(result), folder / LOOKS)
    write_captures(result, folder / CAPTURES)
    write_defects(result, folder)
    reasons = pl.read_csv(folder / DEFECTS, columns=["segment", "reason"], schema_overrides=_TEXTS)
    street_table(result, reasons).write_csv(folder / STREETS)
    (folder / MISSION).write_text(yaml.safe_dump(description(result), sort_keys=False), encoding="utf-8")


def _write_table(table: pl.DataFrame, path: Path) -> None:
    """Write a table by Arrow, whose errors report a full disk."""
    pyarrow.parquet.write_table(table.to_arrow(), path, compression="zstd")

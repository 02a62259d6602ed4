"""A mission's folder: its tables, its defects, its description; and its totals."""

import shutil
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow.parquet
import shapely
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing, writing_folder
from pavetwin.mission.defect_files import write_captures, write_defects
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.look_table import LOOKS, look_table
from pavetwin.mission.mission import Mission
from pavetwin.mission.street_table import STREETS, street_table
from pavetwin.mission.track import MODES
from pavetwin.perception.classes import SIZES
from pavetwin.sensing import JudgedDetection

TOTALS = "totals"
"""Key of a `mission.yaml` beside those of the spec."""

_SUMMED = (
    *("inspected", "defects", "swept", "confirmed", "recovered"),
    *("wait_s", "occlusions", "revisits", "duplicates", "false_alarms"),
)
"""Totals that are sums over the segments."""

_TEXTS = {"segment": pl.String, "reason": pl.String}

_MODE_NAMES = [mode.value for mode in MODES]


@dataclass(frozen=True, slots=True)
class Totals:
    """The totals of a mission. A share that is undefined is None."""

    segments: int
    inspected: int
    """Segments of which enough was seen."""
    defects: int
    swept: int
    confirmed: int
    recovered: int
    coverage: float | None
    swath_coverage: float | None
    recovery: float | None
    surface_coverage: float | None
    """Weighted by area, as the next."""
    permanently_hidden: float | None
    time_s: float
    """From take-off to landing, swaps included."""
    energy: float
    """In batteries."""
    wait_s: float
    distance_m: float
    occlusions: int
    revisits: int
    swaps: int
    duplicates: int
    false_alarms: int
    precision: float | None
    false_alarms_per_100_m2: float | None
    """Of the surface that was seen."""

    @property
    def batteries(self) -> int:
        """Full batteries to bring."""
        return self.swaps + 1


def totals(mission: MissionResult | Mission) -> Totals:
    """The sums over a mission's segments, and the whole flight's time, energy and distance.

    Args:
        mission: one that was flown, or one in flight: then the sums are over the segments that are finished.
    """
    rows = mission.rows
    sums: dict[str, Any] = {name: sum(getattr(row, name) for row in rows) for name in _SUMMED}
    defects, swept, confirmed, false_alarms = (sums[name] for name in ("defects", "swept", "confirmed", "false_alarms"))
    area_m2, seen_m2 = sum(row.area_m2 for row in rows), sum(row.surface_coverage * row.area_m2 for row in rows)
    hidden_m2 = sum(row.permanently_hidden * row.area_m2 for row in rows)
    matched = confirmed + sums["duplicates"]
    return Totals(
        segments=len(rows),
        **sums,
        coverage=confirmed / defects if defects else None,
        swath_coverage=confirmed / swept if swept else None,
        recovery=sums["recovered"] / swept if swept else None,
        surface_coverage=seen_m2 / area_m2 if area_m2 else None,
        permanently_hidden=hidden_m2 / area_m2 if area_m2 else None,
        time_s=mission.duration_s,
        energy=mission.energy,
        distance_m=mission.distance_m,
        swaps=mission.swaps,
        precision=matched / (matched + false_alarms) if matched + false_alarms else None,
        false_alarms_per_100_m2=100 * false_alarms / seen_m2 if seen_m2 else None,
    )


def segment_table(result: MissionResult) -> pl.DataFrame:
    """One row a segment, with the factors of the mission before the metrics."""
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
    """The time series of the UAV's state, a row every look interval, with its WGS 84 position."""
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
    """One row a detection with what it came to, false alarms included; places in WGS 84.

    Sizes are null where the sensor measures none or the image does not show them.
    """
    world, defects = result.environment.world, result.environment.defects
    shapes = [each.footprint or defects[each.defect or 0].polygon for each in result.detections]
    centres = shapely.get_coordinates(shapely.centroid(shapes)).reshape(-1, 2)
    lonlat = world.georeference.to_wgs84(centres)
    columns = {
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
    outlines = shapely.to_wkb(shapely.transform(shapes, world.georeference.to_wgs84))
    rows = [
        (
            *(each.time_s, each.capture, world.segments[each.segment].id, each.outcome.value, each.kind),
            *(each.confidence, each.defect, each.visible_fraction, each.on_revisit, float(lon), float(lat)),
            *_measured(each),
            outline,
        )
        for each, (lon, lat), outline in zip(result.detections, lonlat, outlines, strict=True)
    ]
    return pl.DataFrame(rows, schema=columns, orient="row")


def _measured(detection: JudgedDetection) -> tuple[float | str | bool | None, ...]:
    """The columns `SIZES`, `severity`, `pixel_mm` and `is_cut`."""
    measures = detection.measures
    if measures is None:
        return (None,) * (len(SIZES) + 3)
    sizes = (measures.sizes.get(name) for name in SIZES)
    numbers = (size if isinstance(size, float) else None for size in sizes)
    return (*numbers, measures.sizes.get("severity"), measures.pixel_mm, measures.is_cut)


def description(result: MissionResult) -> dict[str, Any]:
    """The mission's spec, from which it can be flown again, and its totals."""
    return {**result.spec.as_values(), TOTALS: asdict(totals(result))}


def save_mission(result: MissionResult, folder: Path | str) -> None:
    """Write a mission's files into `folder`, all or none. A mission that is there already is replaced.

    Raises:
        PaveTwinError: the folder holds something else or cannot be written.
    """
    folder = Path(folder)
    check_mission_folder(folder)
    with writing_folder(folder, replace=True) as temporary:
        _write(result, temporary)


def save_missions(missions: Iterable[MissionResult], folder: Path) -> None:
    """Write several missions into one folder, a folder each named by its policy.

    Each is written as soon as `missions` yields it, so an error in a later one loses none of those before.

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
                _write_table(tables[0], temporary / "mission.parquet")
                shutil.copyfile(temporary / result.policy / STREETS, temporary / STREETS)
        else:
            with writing_folder(folder / result.policy, replace=True) as temporary:
                _write(result, temporary)
            with writing(folder / "mission.parquet") as path:
                _write_table(pl.concat(tables), path)
            streets = [folder / STREETS, folder / result.policy / STREETS]
            both = "".join(file.read_text(encoding="utf-8").partition("\n")[2] for file in streets)
            heads = streets[0].read_text(encoding="utf-8").partition("\n")[0]
            with writing(folder / STREETS) as path:
                path.write_text(f"{heads}\n{both}", encoding="utf-8")


def check_mission_folder(folder: Path) -> None:
    """Refuse to replace what is not a mission.

    Raises:
        PaveTwinError: the folder exists, is not empty, and holds no mission.
    """
    if not folder.exists():
        return
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / "mission.parquet").is_file()):
        raise PaveTwinError(f"'{folder}' exists and holds no mission; choose another folder.")


def _write(result: MissionResult, folder: Path) -> None:
    _write_table(segment_table(result), folder / "mission.parquet")
    _write_table(track_table(result), folder / "track.parquet")
    _write_table(detections_table(result), folder / "detections.parquet")
    if result.looked_px is not None:
        _write_table(look_table(result), folder / LOOKS)
    write_captures(result, folder / "captures.geojson")
    write_defects(result, folder)
    reasons = pl.read_csv(folder / "defects.csv", columns=["segment", "reason"], schema_overrides=_TEXTS)
    street_table(result, reasons).write_csv(folder / STREETS)
    (folder / "mission.yaml").write_text(yaml.safe_dump(description(result), sort_keys=False), encoding="utf-8")


def _write_table(table: pl.DataFrame, path: Path) -> None:
    """By Arrow's writer, which says plainly when the disk is full."""
    pyarrow.parquet.write_table(table.to_arrow(), path, compression="zstd")

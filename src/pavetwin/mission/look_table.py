"""`looks.parquet`: what every capture showed of the defects, and what a sensor that looks at images found of it."""

import json
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import shapely
import yaml

from pavetwin.config.mission import SensingSettings
from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.inspected_defects import captured_frame
from pavetwin.mission.spec import check_format
from pavetwin.perception.shipped import model_path
from pavetwin.sensing import Outcome
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.sensing.fit.tables import ALARM_SCHEMA, CAPTURE, GROUP, LOOK_COLUMNS, LOOK_SCHEMA, POSE_SCHEMA, LookSource
from pavetwin.sensing.looks import LookMeter
from pavetwin.sensing.registered import load_sensor, sensor_class
from pavetwin.sensing.sensor_model import FittedDetector
from pavetwin.world.georeference import anchored, from_wgs84

LOOKS: Final = "looks.parquet"


def look_table(result: MissionResult) -> pl.DataFrame:
    """One row for each defect that a capture saw, and one with `defect` null for a capture that saw none, in the order
    of captures; the columns of `LOOK_SCHEMA` and `POSE_SCHEMA`.

    Defects count that the mission counts: enough of them is visible, and their centre is in the inspection window.

    Raises:
        ValueError: the mission's sensor looks at no images.
    """
    if result.looked_px is None:
        raise ValueError("what a sensor without images finds are no looks")
    meter, environment = LookMeter(result.looked_px), result.environment
    right = (Outcome.CONFIRMED, Outcome.DUPLICATE)
    found = {(each.capture, each.defect) for each in result.detections if each.outcome in right}
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


def read_looks(folder: Path, model: Path | None = None) -> LookSource:
    """What a mission's folder tells of its detector.

    Args:
        model: the file of its detector, for a mission that does not name it.

    Raises:
        PaveTwinError: the mission was flown with another sensor, is damaged, of an earlier version, or does not name
            its detector.
    """
    check_version(folder)
    said, table, detections = (
        _yaml(folder / "mission.yaml"),
        _table(folder / LOOKS),
        _table(folder / "detections.parquet"),
    )
    try:
        sensing = said["settings"]["sensing"]
        if sensing["sensor"] != "detector":
            raise ValueError(f"the sensor is {sensing['sensor']}")
        options = {**DetectorSensor.default_options, **sensing["options"]}
        if (content := detector_of(said, model)) is None:
            raise PaveTwinError(f"'{folder}' does not say which detector looked at its images; name it with `model`.")
        detector = FittedDetector(
            sha256=content,
            confidence=options["confidence"],
            image_px=int(table["image_px"].max()),  # type: ignore[arg-type]
        )
        place = f"{said['world']['content_hash']} {said['defects']['content_hash']}"
        has_poses = set(POSE_SCHEMA) <= set(table.columns)
        schema = {**LOOK_SCHEMA, **POSE_SCHEMA} if has_poses else LOOK_SCHEMA
        table = table.select(pl.col(name).cast(kind) for name, kind in schema.items())
        images = table.unique("capture", keep="first", maintain_order=True)
        number = {capture: row for row, capture in enumerate(images["capture"])}
        alarms = detections.filter(pl.col("outcome") == Outcome.FALSE_ALARM.value)
        alarms = alarms.select(
            pl.col("capture").replace_strict(number).alias("image"),
            pl.col("class").alias("kind"),
            (1000.0 * pl.Series(_sides_m(alarms["footprint"].to_list())) / pl.col("pixel_mm")).alias("size_px"),
        )
    except (KeyError, TypeError, StopIteration, ValueError, pl.exceptions.PolarsError) as error:
        raise PaveTwinError(
            f"'{folder}' is no mission of the sensor 'detector', or it is damaged ({type(error).__name__}: {error}); "
            "fly it again."
        ) from error
    looks = table.drop_nulls("defect").with_columns(
        (pl.lit(f"{place} ") + pl.col("defect").cast(pl.String)).alias(GROUP)
    )
    return LookSource(
        name=folder.name,
        detector=detector,
        looks=looks.select(GROUP, "found", *LOOK_COLUMNS),
        images=images.select(
            "area_m2", "pixel_mm", (_captured(said) if has_poses else pl.lit(None, pl.String)).alias(CAPTURE)
        ),
        alarms=alarms.select(pl.col(name).cast(kind) for name, kind in ALARM_SCHEMA.items()),
    )


def _captured(said: Any) -> pl.Expr:
    """What names captures: all that decides an image, the policy that led there aside, and the pose."""
    names = ("defects", "traffic", "aircraft", "seed", "parking_seed", "parking_mix")
    same = {name: said.get(name) for name in names} | {"world": said["world"]["content_hash"]}
    same["settings"] = {name: value for name, value in said["settings"].items() if name != "policy"}
    mission = sha256(json.dumps(same, sort_keys=True, default=str).encode()).hexdigest()
    return pl.concat_str(pl.lit(mission), *POSE_SCHEMA, separator=" ")


def detector_sha256(folder: Path, model: Path | None = None) -> str | None:
    """SHA-256 of the model file that looked at a mission's images; None where another sensor was flown, or the mission
    does not say.

    Args:
        model: the file of its detector, for a mission that does not name it.
    """
    try:
        said = _yaml(folder / "mission.yaml")
        return detector_of(said, model) if said["settings"]["sensing"]["sensor"] == "detector" else None
    except (KeyError, TypeError, PaveTwinError):
        return None


def check_version(folder: Path) -> None:
    """Raises:
    PaveTwinError: the `mission.yaml` of a folder cannot be read, or is of a format that this version does not read.
    """
    path = folder / "mission.yaml"
    said = _yaml(path)
    check_format(path, said.get("format") if isinstance(said, dict) else None)


def names_no_detector(folder: Path) -> bool:
    """Whether a detector looked at a mission's images, and the mission does not say which: earlier versions named none
    that was the default, which has been another since."""
    try:
        sensing = _yaml(folder / "mission.yaml")["settings"]["sensing"]
        return bool(sensing["sensor"] == "detector" and "model" not in sensing["options"])
    except (KeyError, TypeError, PaveTwinError):
        return False


def measures_sizes(folder: Path, model: Path | None = None) -> bool:
    """Whether the sensor of a mission measures sizes; not where it cannot be asked, as one whose file is gone.

    Args:
        model: the file of its detector, for a mission that does not name it.
    """
    if (unnamed := names_no_detector(folder)) and model is None:
        return False
    try:
        sensing = SensingSettings.model_validate(_yaml(folder / "mission.yaml")["settings"]["sensing"])
        if unnamed:
            sensing = sensing.model_copy(update={"options": {**sensing.options, "model": str(model)}})
        return sensor_class(sensing.sensor).measures_sizes and load_sensor(sensing, 0).measures_sizes
    except (KeyError, TypeError, ValueError, PaveTwinError):
        return False


def detector_of(said: Any, unnamed: Path | None = None) -> str | None:
    """SHA-256 of the model file of a mission of the sensor `detector`; None where neither names one.

    Args:
        said: the values of its spec.
        unnamed: the model file where the mission names none.

    Raises:
        PaveTwinError: no model of that name ships.
    """
    model = said["settings"]["sensing"]["options"].get("model")
    if model is None:
        return None if unnamed is None else file_sha256(unnamed)
    own = {each["path"]: each["sha256"] for each in said["plugins"]}
    return own.get(model) or file_sha256(model_path(model))


def _sides_m(outlines: Sequence[bytes]) -> list[float]:
    """Roots of the areas of footprints in degrees."""
    shapes = shapely.from_wkb(outlines)
    if not len(shapes):
        return []
    frame = anchored(shapes[0].centroid.y, shapes[0].centroid.x)
    return [float(side) for side in np.sqrt(shapely.area(shapely.transform(shapes, partial(from_wgs84, frame))))]


def _yaml(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise PaveTwinError(f"'{path}' cannot be read ({type(error).__name__}); fly the mission again.") from error


def _table(path: Path) -> pl.DataFrame:
    try:
        return pl.read_parquet(path)
    except (OSError, pl.exceptions.PolarsError) as error:
        words = "is damaged" if path.is_file() else "is not there"
        hint = "; only missions of the sensor 'detector' have it" if path.name == LOOKS else ""
        raise PaveTwinError(f"'{path}' {words}{hint}; fly the mission again.") from error

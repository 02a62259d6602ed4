"""The folder of a mission: its description, tables and captures, read once, and the comparison with another flight.

```python
mission = MissionFolder("missions/monday")
mission.spec, mission.totals, mission.track, mission.captures
result = fly(mission.planned(world_of(mission.spec.world)))
mission.verdict(result)
```
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cached_property, partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import shapely
import yaml
from pydantic import ValidationError

from pavetwin.config.mission import SensingSettings
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError
from pavetwin.files import check_format, file_sha256
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.mission.metrics import totals
from pavetwin.mission.planning import defect_input
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import (
    CAPTURES,
    DEFECTS,
    DETECTION_COLUMNS,
    DETECTIONS,
    LOOKS,
    MISSION,
    SEGMENTS,
    TOTALS,
    TRACK,
    detections_geojson,
)
from pavetwin.mission.spec import FileInput, MissionSpec, TrafficInput, WorldInput
from pavetwin.mission.versions import version_changes
from pavetwin.perception.model_file import model_path
from pavetwin.sensing import Outcome
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.sensing.fit.look_tables import (
    ALARM_SCHEMA,
    CAPTURE,
    GROUP,
    LOOK_COLUMNS,
    LOOK_SCHEMA,
    POSE_SCHEMA,
    LookSource,
)
from pavetwin.sensing.fitted_sensor import FittedDetector
from pavetwin.sensing.sensor import load_sensor, sensor_class
from pavetwin.world.folder import DESCRIPTION, read_description
from pavetwin.world.georeference import anchored, from_wgs84
from pavetwin.world.model import World


class MissionFolder:
    """The folder of one mission. `mission.yaml` is read immediately, every other file on first use."""

    def __init__(self, place: Path | str, *, other_policy: bool = False) -> None:
        """Args:
            place: the folder, or its `mission.yaml`.
            other_policy: the mission is to be flown with another policy, so that the files of its own policy may be
            missing.

        Raises:
            PaveTwinError: there is no `mission.yaml`, one for each policy, a damaged one or one of another format.
        """
        self.file = mission_file(Path(place))
        """Its `mission.yaml`."""
        self.values = _read(self.file)
        """The content of `mission.yaml`."""
        self._other_policy = other_policy

    @property
    def folder(self) -> Path:
        return self.file.parent

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.file.absolute().parent.name

    @property
    def totals(self) -> Mapping[str, Any]:
        """The mission's `Totals` by name."""
        sums: Mapping[str, Any] = self.values[TOTALS]
        return sums

    @cached_property
    def spec(self) -> MissionSpec:
        """The specification.

        A world or file that is no longer at its path is looked for by the last parts of the path, in the folders above
        `mission.yaml`: results that were moved together with their world are found. The content must be the same.

        Raises:
            PaveTwinError: files that the mission depends on are missing or have changed, or a value does not fit; the
                message names each.
        """
        values = {key: value for key, value in self.values.items() if key != TOTALS}
        values = _relocated(values, self.file.resolve())
        # Before the settings are read, which loads the user's own code.
        named = [value for key, value in values.items() if not (self._other_policy and key == "policy")]
        if changed := [difference for file in _files(named) if (difference := file.difference())]:
            raise PaveTwinError(f"The mission's inputs have changed: {'; '.join(changed)}.")
        return MissionSpec.parse(values, where=f"'{self.file}'")

    @cached_property
    def sensing(self) -> SensingSettings:
        """The sensor and its options, without a check of other inputs.

        Raises:
            PaveTwinError: they are damaged.
        """
        try:
            return SensingSettings.model_validate(self.values["settings"]["sensing"])
        except (KeyError, TypeError, ValidationError) as error:
            raise PaveTwinError(f"'{self.file}' is damaged: it has no sensor. Fly the mission again.") from error

    @cached_property
    def detector(self) -> str | None:
        """SHA-256 of the model file that looked at the images; None where another sensor was flown.

        Raises:
            PaveTwinError: no model of that name ships.
        """
        plugins = [FileInput.parse(each, where=f"'{self.file}'") for each in self.values["plugins"]]
        return detector_of(self.sensing, plugins)

    @cached_property
    def measures_sizes(self) -> bool:
        """True if the sensor measures sizes; False if not, or if its file is missing."""
        try:
            kind = sensor_class(self.sensing.sensor)
            return kind.measures_sizes and load_sensor(self.sensing, 0).measures_sizes
        except PaveTwinError:
            return False

    @cached_property
    def rows(self) -> pl.DataFrame:
        """The metrics, one row per segment (`segment_table`)."""
        return self.table(SEGMENTS)

    @cached_property
    def track(self) -> pl.DataFrame:
        """The UAV's state over time (`track_table`)."""
        return self.table(TRACK)

    @cached_property
    def detections(self) -> pl.DataFrame:
        """All detections (`detections_table`)."""
        table = self.table(DETECTIONS)
        if missing := [name for name in DETECTION_COLUMNS if name not in table.columns]:
            raise PaveTwinError(
                f"'{self.folder / DETECTIONS}' is damaged: it has no column '{missing[0]}'; fly the mission again."
            )
        return table

    @cached_property
    def captures(self) -> Mapping[str, Any] | None:
        """The confirmed defects of `captures.geojson` without the images of frames; None if missing or damaged."""
        try:
            content: dict[str, Any] = json.loads((self.folder / CAPTURES).read_text(encoding="utf-8"))
            for feature in content["features"]:
                feature["properties"].pop("frame", None)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return content

    def table(self, name: str) -> pl.DataFrame:
        """A Parquet file of the folder.

        Raises:
            PaveTwinError: it is missing or damaged.
        """
        path = self.folder / name
        try:
            return pl.read_parquet(path)
        except (OSError, pl.exceptions.PolarsError) as error:
            words = "is damaged" if path.is_file() else "is missing"
            hint = "; only missions of the sensor 'detector' have it" if name == LOOKS else ""
            raise PaveTwinError(f"'{path}' {words}{hint}; fly the mission again.") from error

    def looks(self) -> LookSource:
        """The looks of its detector, for fitting a sensor.

        Raises:
            PaveTwinError: the mission was flown with another sensor, or is damaged.
        """
        table, detections = self.table(LOOKS), self.detections
        try:
            if (content := self.detector) is None:
                raise ValueError(f"the sensor is {self.sensing.sensor}")
            options = {**DetectorSensor.default_options, **self.sensing.options}
            detector = FittedDetector(
                sha256=content,
                confidence=float(options["confidence"]),
                image_px=int(table["image_px"].max()),  # type: ignore[arg-type]
            )
            place = f"{self.values['world']['content_hash']} {self.values['defects']['content_hash']}"
            table = table.select(pl.col(name).cast(kind) for name, kind in {**LOOK_SCHEMA, **POSE_SCHEMA}.items())
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
                f"'{self.folder}' is not a mission of the sensor 'detector', or it is damaged ({type(error).__name__}: "
                f"{error}); fly it again."
            ) from error
        looks = table.drop_nulls("defect").with_columns(
            (pl.lit(f"{place} ") + pl.col("defect").cast(pl.String)).alias(GROUP)
        )
        return LookSource(
            name=self.folder.name,
            detector=detector,
            looks=looks.select(GROUP, "found", *LOOK_COLUMNS),
            images=images.select("area_m2", "pixel_mm", self._capture_ids().alias(CAPTURE)),
            alarms=alarms.select(pl.col(name).cast(kind) for name, kind in ALARM_SCHEMA.items()),
        )

    def _capture_ids(self) -> pl.Expr:
        """Ids of captures: a hash of everything that decides an image except the policy, and the pose."""
        names = ("defects", "traffic", "aircraft", "seed", "parking_seed", "parking_mix")
        same = {name: self.values[name] for name in names} | {"world": self.values["world"]["content_hash"]}
        same["settings"] = {name: value for name, value in self.values["settings"].items() if name != "policy"}
        mission = sha256(json.dumps(same, sort_keys=True, default=str).encode()).hexdigest()
        return pl.concat_str(pl.lit(mission), *POSE_SCHEMA, separator=" ")

    @property
    def folder_again(self) -> Path:
        """Where the results go when it is flown again: next to its own folder."""
        return self.file.absolute().parent.with_name(f"{self.name}-again")

    @property
    def folder_of_missed(self) -> Path:
        """Where the results go when only the missed segments are flown again: next to its own folder."""
        return self.file.absolute().parent.with_name(f"{self.name}-missed")

    def missed_segments(self) -> tuple[str, ...]:
        """Ids of the inspected segments on which it missed a defect, in their order.

        Defects under or behind parked vehicles do not count: the same vehicles are parked when it is flown again.

        Raises:
            PaveTwinError: the table of its defects cannot be read, or nothing was missed.
        """
        path = self.folder / DEFECTS
        columns = dict.fromkeys(("segment", "outcome", "reason"), pl.String)
        try:
            table = pl.read_csv(path, columns=list(columns), schema_overrides=columns)
        except (OSError, pl.exceptions.PolarsError) as error:
            raise PaveTwinError(f"'{path}' cannot be read; fly the mission again as a whole.") from error
        missed = table.filter(pl.col("outcome") == "missed")
        parked = pl.col("reason") == MissReason.HIDDEN_BY_PARKED_VEHICLES.value
        visible = missed.filter(~parked.fill_null(value=False))
        if visible.is_empty():
            hidden = "; what it missed is under or behind parked vehicles" if missed.height else ""
            raise PaveTwinError(f"'{self.folder}' missed no defect that another flight could find{hidden}.")
        there = set(visible["segment"])
        return tuple(target for target in dict.fromkeys(self.spec.targets) if target in there)

    def planned(
        self,
        world: World,
        *,
        policy: str | None = None,
        defect_seed: int | None = None,
        targets: Sequence[str] | None = None,
    ) -> MissionSpec:
        """The spec for another flight.

        Args:
            world: the mission's world, wherever it is now.
            policy: another policy.
            defect_seed: seed for other defects.
            targets: ids of other segments.
        """
        changes: dict[str, Any] = {} if targets is None else {"targets": tuple(targets)}
        if world.content_hash == self.spec.world.content_hash:
            changes["world"] = WorldInput.of(world)
        if defect_seed is not None:
            changes["defects"] = defect_input(world, defect_seed)
        spec = self.spec.model_copy(update=changes)
        return spec if policy is None else spec.with_policy(policy)

    def verdict(self, result: MissionResult) -> str:
        """Comparison of a second flight with this one, as a sentence."""
        if not _is_same(result.spec, self.spec):
            return "Not the same mission as before: an option changed it."
        if different := self.differences(result):
            return f"Not the same as the first time ({', '.join(different)})."
        return "The same as the first time."

    def is_contradicted_by(self, result: MissionResult) -> bool:
        """True if the same mission, flown again, gave other results."""
        return _is_same(result.spec, self.spec) and bool(self.differences(result))

    def differences(self, result: MissionResult) -> list[str]:
        """Names of the totals and files that differ; empty if all are the same."""
        now = asdict(totals(result))
        other = [name for name, value in self.totals.items() if now.get(name) != value]
        if self.captures is not None and self.captures != detections_geojson(result):
            other.append("captures")
        return other

    def version_changes(self) -> list[str]:
        """Software whose version differs from that of the flight, in words."""
        return version_changes(self.spec.versions)


def detector_of(sensing: SensingSettings, plugins: Iterable[FileInput]) -> str | None:
    """SHA-256 of the model file of the sensor `detector`; None for another sensor.

    Args:
        plugins: the files of a mission's spec.

    Raises:
        PaveTwinError: no model of that name ships.
    """
    if sensing.sensor != "detector":
        return None
    model = str(sensing.options["model"])
    own = {file.path: file.sha256 for file in plugins}
    return own.get(model) or file_sha256(model_path(model))


def _is_same(one: MissionSpec, other: MissionSpec) -> bool:
    """True if two specs describe the same mission, wherever its world is and whatever software flies it."""
    unlike = {"versions": {}, "world": one.world}
    return one.world.content_hash == other.world.content_hash and one.model_copy(update=unlike) == other.model_copy(
        update=unlike
    )


def mission_file(place: Path) -> Path:
    """The `mission.yaml` of a folder, or the file itself.

    Raises:
        PaveTwinError: the folder holds a mission for each policy.
    """
    if place.is_file() or (place / MISSION).is_file():
        return place if place.is_file() else place / MISSION
    if inner := sorted(path.parent.name for path in place.glob(f"*/{MISSION}")):
        names = ", ".join(str(place / name) for name in inner)
        raise PaveTwinError(f"'{place}' holds a mission for each policy; name one: {names}.")
    return place / MISSION


def check_replaceable(folder: Path, specs: Iterable[MissionSpec], *, force: bool = False) -> None:
    """Refuse to replace missions by others.

    Args:
        specs: the missions to be flown into the folder. If one allows the nearest traffic, missions in any such
            traffic count as the same.

    Raises:
        PaveTwinError: the folder holds other missions, and `force` is not given.
    """
    there = [*folder.glob("mission.yaml"), *folder.glob("*/mission.yaml")]
    if force or not there:
        return
    old, new = [_read(path) for path in there], list(specs)
    differing = [[_differing(one, other) for other in new] for one in old]
    if len(new) == len(old) and all([] in of_one for of_one in differing):
        return
    words = f" (other {', '.join(differing[0][0])})" if len(new) == len(old) == 1 else ""
    raise PaveTwinError(f"'{folder}' holds another mission{words}; choose another folder, or replace it (`force`).")


def _differing(old: Mapping[str, Any], spec: MissionSpec) -> list[str]:
    """The keys of a `mission.yaml` in which a mission to be flown differs, results and versions aside."""
    new = spec.as_values()
    keys = (old.keys() | new.keys()) - {TOTALS, "versions"}
    return sorted(
        key
        for key in keys
        if old.get(key) != new.get(key) and not (key == "traffic" and _may_become(spec.traffic, old.get(key)))
    )


def _may_become(named: TrafficInput, flown: Any) -> bool:
    """True if recording the traffic of a spec may give that of a `mission.yaml`."""
    try:
        return named.allows(TrafficInput.parse(flown, where="traffic"))
    except PaveTwinError:
        return False


def _relocated(values: Mapping[str, Any], description: Path) -> Any:
    """Plain values with the paths of moved files and folders replaced, where they are found."""
    moved: dict[str, str] = {}

    def look_for(path: str, is_it: Callable[[Path], bool]) -> None:
        place = Path(path)
        if place.is_absolute() and not place.exists():
            tails = [Path(*place.parts[-count:]) for count in range(len(place.parts) - 1, 0, -1)]
            candidates = (folder / tail for folder in description.parents for tail in (*tails, Path()))
            if found := next(filter(is_it, candidates), None):
                moved[path] = str(found)

    for file in _files(values):
        look_for(file.path, partial(_is_file, sha256=file.sha256))
    world = values.get("world")
    if isinstance(world, Mapping):
        look_for(str(world.get("path")), partial(_is_world, content_hash=world.get("content_hash")))
    return _with_places(values, moved)


def _is_file(place: Path, sha256: str) -> bool:
    return place.is_file() and file_sha256(place) == sha256


def _is_world(folder: Path, content_hash: Any) -> bool:
    try:
        return (folder / DESCRIPTION).is_file() and read_description(folder).get("content_hash") == content_hash
    except PaveTwinError:
        return False


def _with_places(value: Any, moved: Mapping[str, str]) -> Any:
    """Plain values with each path that is in `moved`, alone or before a class name, replaced."""
    if isinstance(value, Mapping):
        return {key: _with_places(inner, moved) for key, inner in value.items()}
    if isinstance(value, list):
        return [_with_places(inner, moved) for inner in value]
    if isinstance(value, str):
        path, colon, name = value.rpartition(":")
        if colon and path in moved:
            return f"{moved[path]}:{name}"
        return moved.get(value, value)
    return value


def _files(value: Any) -> Iterator[FileInput]:
    """All files named in plain values."""
    if isinstance(value, Mapping):
        if set(value) == {"path", "sha256"}:
            yield FileInput(path=str(value["path"]), sha256=str(value["sha256"]))
        else:
            yield from (file for inner in value.values() for file in _files(inner))
    elif isinstance(value, list):
        yield from (file for inner in value for file in _files(inner))


def _sides_m(outlines: Sequence[bytes]) -> list[float]:
    """Roots of the areas of footprints in degrees."""
    shapes = shapely.from_wkb(outlines)
    if not len(shapes):
        return []
    frame = anchored(shapes[0].centroid.y, shapes[0].centroid.x)
    return [float(side) for side in np.sqrt(shapely.area(shapely.transform(shapes, partial(from_wgs84, frame))))]


def _read(path: Path) -> dict[str, Any]:
    try:
        values = parse_yaml(path.read_text(encoding="utf-8"), where=f"'{path}'")
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{path}': {error.strerror or error}.") from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        raise PaveTwinError(f"'{path}' is not a whole mission.yaml.") from error
    if not isinstance(values, dict):
        raise PaveTwinError(f"'{path}' is not a mission.yaml.")
    check_format(values.get("format"), f"The mission '{path}'")
    if not isinstance(values.get(TOTALS), dict):
        raise PaveTwinError(f"'{path}' is not a whole mission.yaml: it has no totals.")
    return values

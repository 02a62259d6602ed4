"""Reading a mission's description, and comparing a mission that was flown again with what it was."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import polars as pl
import yaml

from pavetwin.config.base import overlay
from pavetwin.config.text import parse_yaml
from pavetwin.defects.placement import as_written
from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.mission.defect_files import detections_geojson
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.mission.plan import defect_input
from pavetwin.mission.results import TOTALS, totals
from pavetwin.mission.spec import FORMAT, READABLE, FileInput, MissionSpec, TrafficInput, WorldInput, check_format
from pavetwin.mission.versions import version_changes
from pavetwin.sensing.registered import unnamed_models
from pavetwin.world.folder import DESCRIPTION, read_description
from pavetwin.world.model import World

MISSION: Final = "mission.yaml"
"""In the folder of a mission."""

DEFECTS: Final = "defects.csv"
"""Beside it: what became of each defect."""

OF_ROTOR: Final = ("capacity_wh", "hover_endurance_s", "mass_kg")
"""Keys of `settings.energy` that described the aircraft before format 5."""


@dataclass(frozen=True, slots=True)
class FormerMission:
    """A `mission.yaml`: the spec, and what came out of the mission."""

    path: Path
    spec: MissionSpec
    totals: Mapping[str, Any]
    detections: Any
    """The `captures.geojson` beside it; None where it is not there any more."""

    @property
    def folder_again(self) -> Path:
        """Where the results go when it is flown again: beside its own folder."""
        folder = self.path.absolute().parent
        return folder.with_name(f"{folder.name}-again")

    @property
    def folder_of_missed(self) -> Path:
        """Where the results go when only what it missed is flown again: beside its own folder."""
        folder = self.path.absolute().parent
        return folder.with_name(f"{folder.name}-missed")

    def missed_segments(self) -> tuple[str, ...]:
        """Ids of the inspected segments on which it missed a defect, in their order.

        Defects under or behind parked vehicles do not count: the same vehicles are parked when it is flown again.

        Raises:
            PaveTwinError: the table of its defects cannot be read, or nothing was missed.
        """
        path = self.path.with_name(DEFECTS)
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
            raise PaveTwinError(f"'{self.path.parent}' missed no defect that another flight could find{hidden}.")
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
        """The spec to fly it again.

        Args:
            world: its own, wherever that is now.
            policy: in place of its own.
            defect_seed: place the defects under this seed, in place of its defects.
            targets: ids of segments, in place of its own.
        """
        changes: dict[str, Any] = {} if targets is None else {"targets": tuple(targets)}
        if world.content_hash == self.spec.world.content_hash:
            changes["world"] = WorldInput.of(world)
        if defect_seed is not None:
            changes["defects"] = defect_input(world, defect_seed)
        spec = self.spec.model_copy(update=changes).with_models()
        return spec if policy is None else spec.with_policy(policy)

    def verdict(self, result: MissionResult) -> str:
        """Whether a mission that was flown again gave the same results, as a sentence."""
        if not _is_same(result.spec, self.spec.with_models()):
            return "Not the same mission as before: an option changed it."
        if different := self.differences(result):
            return f"Not the same as the first time ({', '.join(different)})."
        return "The same as the first time."

    def is_contradicted_by(self, result: MissionResult) -> bool:
        """Whether the same mission, flown again, gave other results."""
        return _is_same(result.spec, self.spec.with_models()) and bool(self.differences(result))

    def differences(self, result: MissionResult) -> list[str]:
        """Names of what came out differently; empty when all is the same."""
        now = asdict(totals(result))
        other = [name for name, value in self.totals.items() if now.get(name) != value]
        if self.detections is not None and not _same_captures(self.detections, detections_geojson(result)):
            other.append("captures")
        return other

    def unnamed_models(self) -> str | None:
        """A sentence where it does not say which model its sensor had; None where it does, or the sensor has none.

        Earlier versions named no model that was the default.
        """
        sensing = self.spec.settings.sensing
        now = ", ".join(map(str, unnamed_models(sensing).values()))
        if not now:
            return None
        return f"'{self.path}' does not say which model its sensor '{sensing.sensor}' had; now it is {now}."

    def version_changes(self) -> list[str]:
        """Software that is another now than when the mission was flown, in words."""
        return version_changes(self.spec.versions)


def _same_captures(former: Any, now: Mapping[str, Any]) -> bool:
    """Whether two `captures.geojson` agree in all that the former one holds: older ones have fewer properties."""
    before, after = former["features"], now["features"]
    return len(before) == len(after) and all(
        (one.get("id"), one.get("geometry")) == (other["id"], other["geometry"])
        and one["properties"].items() <= other["properties"].items()
        for one, other in zip(before, after, strict=True)
    )


def _is_same(one: MissionSpec, other: MissionSpec) -> bool:
    """Whether two specs describe the same mission, wherever its world is, and whatever software flies it."""
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


def read_mission(path: str | Path, *, other_policy: bool = False) -> FormerMission:
    """The mission that a `mission.yaml` describes.

    A world or file that is not at its path any more is looked for by the last names of its path, in the folders that
    the `mission.yaml` is in: results that were moved together with their world are found. Its content must be the same.

    Args:
        other_policy: it will be flown with another policy, so that its own need not be there any more.

    Raises:
        PaveTwinError: the file is missing, damaged, or of another version, or files that the mission depends on are
            gone or have changed; the message names each.
    """
    path = Path(path)
    values = dict(_read(path))
    check_format(path, values.get("format"))
    if values["format"] == 3:
        values["settings"] = overlay({"uav": {"base": "street"}}, values.get("settings", {}))  # there was no other
    if values["format"] < FORMAT:
        values["settings"] = _without_aircraft(path, values.get("settings", {}))
    values["format"] = FORMAT
    values["defects"] = _as_placed(values.get("defects", {}))
    sums = values.pop(TOTALS, None)
    if not isinstance(sums, Mapping):
        raise PaveTwinError(f"'{path}' is not a whole mission.yaml: it has no totals.")
    values = dict(_relocated(values, path.resolve()))
    # Before the settings are read, which loads the user's own code.
    files = [file for key, value in values.items() if not (other_policy and key == "policy") for file in _files(value)]
    if changed := [difference for file in files if (difference := file.difference())]:
        raise PaveTwinError(f"The mission's inputs are not what they were: {'; '.join(changed)}.")
    spec = MissionSpec.parse(values, where=f"'{path}'")
    return FormerMission(path, spec, dict(sums), _detections(path.with_name("captures.geojson")))


def _as_placed(defects: Any) -> Any:
    """The defects of a `mission.yaml` of any version, with the population that they were placed by."""
    if not isinstance(defects, Mapping) or defects.get("seed") is None:
        return defects
    return {**defects, "options": as_written(defects.get("options") or {})}


def _without_aircraft(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings from before there were aircraft.

    Raises:
        PaveTwinError: the mission was flown with the rotor model of then.
    """
    energy = settings.get("energy", {})
    if energy.get("model") != "linear":
        raise PaveTwinError(
            f"'{path}' is of an older format than {FORMAT}, with a model of the battery that this version does not "
            f"have; it reads format {FORMAT}, and {' and '.join(map(str, READABLE[:-1]))} with `energy.model=linear`: "
            "fly the mission again from its options, with an aircraft."
        )
    kept = {key: value for key, value in energy.items() if key not in OF_ROTOR}
    return {**settings, "aircraft": None, "energy": kept}


def check_replaceable(folder: Path, specs: Iterable[MissionSpec], *, force: bool = False) -> None:
    """Refuse to replace missions by others.

    Args:
        specs: what is to be flown into the folder. Where one allows the nearest traffic to what it names, missions in
            any such traffic count as the same.

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
    """Whether recording the traffic that a spec names may give what a `mission.yaml` holds."""
    try:
        return named.allows(TrafficInput.parse(flown, where="traffic"))
    except PaveTwinError:
        return False


def _relocated(values: Mapping[str, Any], description: Path) -> Any:
    """Plain values with the paths of what is gone replaced by where it is now, as far as it is found."""
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
    """The files that are named anywhere in plain values."""
    if isinstance(value, Mapping):
        if set(value) == {"path", "sha256"}:
            yield FileInput(path=str(value["path"]), sha256=str(value["sha256"]))
        else:
            yield from (file for inner in value.values() for file in _files(inner))
    elif isinstance(value, list):
        yield from (file for inner in value for file in _files(inner))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        values = parse_yaml(path.read_text(encoding="utf-8"), where=f"'{path}'")
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{path}': {error.strerror or error}.") from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        raise PaveTwinError(f"'{path}' is not a whole mission.yaml.") from error
    if not isinstance(values, Mapping):
        raise PaveTwinError(f"'{path}' is not a mission.yaml.")
    if isinstance(traffic := values.get("traffic"), Mapping):
        # Format 4 once had the area that is simulated: always the whole world.
        return {**values, "traffic": {key: value for key, value in traffic.items() if key != "area"}}
    return values


def _detections(path: Path) -> Any:
    """What a mission found, without the frames that were taken of it afterwards."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        for feature in content["features"]:
            feature["properties"].pop("frame", None)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return content

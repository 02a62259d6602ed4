"""Reading a mission's description, and comparing a mission that was flown again with what it was."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.results import TOTALS, detections_geojson, totals
from pavetwin.mission.spec import FORMAT, FileInput, MissionSpec


@dataclass(frozen=True, slots=True)
class FormerMission:
    """A `mission.yaml`: the spec, and what came out of the mission."""

    spec: MissionSpec
    totals: Mapping[str, Any]
    detections: Any
    """The `captures.geojson` beside it; None where it is not there any more."""

    def differences(self, result: MissionResult) -> list[str]:
        """Names of what came out differently; empty when all is the same."""
        now = asdict(totals(result))
        other = [name for name, value in self.totals.items() if now.get(name) != value]
        if self.detections is not None and self.detections != detections_geojson(result):
            other.append("captures")
        return other

    def version_changes(self) -> list[str]:
        """Software that is another now than when the mission was flown, in words."""
        now = MissionSpec.model_fields["versions"].get_default(call_default_factory=True)
        return [
            f"{name} {before} (now {now.get(name, 'not installed')})"
            for name, before in self.spec.versions.items()
            if now.get(name) != before
        ]


def read_mission(path: str | Path, *, other_policy: bool = False) -> FormerMission:
    """The mission that a `mission.yaml` describes.

    Args:
        other_policy: it will be flown with another policy, so that its own need not be there any more.

    Raises:
        PaveTwinError: the file is missing, damaged, or of another version, or files that the mission depends on are
            gone or have changed; the message names each.
    """
    path = Path(path)
    values = dict(_read(path))
    if values.get("format") != FORMAT:
        raise PaveTwinError(
            f"'{path}' is no mission.yaml of format {FORMAT}, which this version reads; fly the mission again from its "
            "options."
        )
    sums = values.pop(TOTALS, None)
    if not isinstance(sums, Mapping):
        raise PaveTwinError(f"'{path}' is not a whole mission.yaml: it has no totals.")
    # Before the settings are read, which loads the user's own code.
    files = [file for key, value in values.items() if not (other_policy and key == "policy") for file in _files(value)]
    if changed := [difference for file in files if (difference := file.difference())]:
        raise PaveTwinError(f"The mission's inputs are not what they were: {'; '.join(changed)}.")
    spec = MissionSpec.parse(values, where=f"'{path}'")
    return FormerMission(spec, dict(sums), _detections(path.with_name("captures.geojson")))


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

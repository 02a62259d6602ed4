"""Flying a mission again from its `mission.yaml`."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import USER, Density, density_named, density_of
from pavetwin.world.model import World

OWN_NUMBERS: Final = re.compile(r"v(\d[\d.e+-]*)-p(\d[\d.e+-]*)")
"""The name of a density of the user's own numbers (`density_of`)."""


@dataclass(frozen=True, slots=True)
class FormerMission:
    """What a `mission.yaml` says that decides how its mission is flown, and what came out."""

    settings: MissionSettings
    policy: str
    seed: int
    segments: tuple[str, ...]
    """In the order in which they were inspected."""
    density: Density | None
    """None for a user's own routes."""
    traffic_seed: int
    totals: Mapping[str, Any]
    detections: Any
    """The `captures.geojson` beside it; None where it is not there any more."""


def read_mission(path: str | Path, world: World) -> FormerMission:
    """The mission that `path`, a `mission.yaml`, describes.

    Raises:
        PaveTwinError: the file is missing or damaged, or the mission was flown over another world.
    """
    path = Path(path)
    values = _read(path)
    try:
        flown_over = values["world"]["content_hash"]
        if flown_over != world.content_hash:
            raise PaveTwinError(
                f"--again: the mission of '{path}' was flown over the world '{values['world']['name']}' "
                f"({str(flown_over)[:12]}), which '{world.name}' ({world.content_hash[:12]}) is not; give that world."
            )
        density, traffic_seed = _traffic(str(values["traffic"]))
        return FormerMission(
            settings=MissionSettings.parse(values["settings"], where=f"--again: '{path}'"),
            policy=str(values["policy"]),
            seed=int(values["seed"]),
            segments=tuple(str(name) for name in values["segments"]),
            density=density,
            traffic_seed=traffic_seed,
            totals=dict(values["totals"]),
            detections=_detections(path.with_name("captures.geojson")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise PaveTwinError(f"--again: '{path}' is not a whole mission.yaml ({error}).") from error


def _read(path: Path) -> Mapping[str, Any]:
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PaveTwinError(f"--again: cannot read '{path}': {error.strerror or error}.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise PaveTwinError(f"--again: '{path}' is not a whole mission.yaml.") from error
    if not isinstance(values, Mapping):
        raise PaveTwinError(f"--again: '{path}' is not a mission.yaml.")
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


def _traffic(name: str) -> tuple[Density | None, int]:
    """The density and the seed of a recording's name, such as `high-1`."""
    density, _, seed = name.rpartition("-")
    if density.split("-")[0] == USER:
        return None, int(seed)
    own = OWN_NUMBERS.fullmatch(density)
    return density_of(float(own[1]), float(own[2])) if own else density_named(density), int(seed)

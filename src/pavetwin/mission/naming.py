"""The folder of a mission where the user gives none."""

import json
import os
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from pavetwin.config import load_settings
from pavetwin.mission.plan import ALL
from pavetwin.mission.spec import FileInput, MissionSpec, PolicyInput
from pavetwin.policies import policy_names


def mission_folder(
    spec: MissionSpec, policies: Sequence[str], preset: str, *, usual_targets: bool, usual_base: bool = True
) -> Path:
    """In the world's folder `missions`, or in `missions/WORLD` here where nothing can be written there: what is asked
    for most, and a short hash of all that is unusual, as in `hover-high-1-10m-default-seed1-3f2a9c`.

    Args:
        policies: one, or several that are flown over the same.
        usual_targets: whether the targets follow from the seed alone.
        usual_base: whether the base follows from the settings.
    """
    unusual: dict[str, object] = {}
    if not usual_targets:
        unusual["targets"] = spec.targets
    if not usual_base:
        unusual["base"] = spec.base
    if spec.defects.seed is not None:
        unusual["defect_seed"] = spec.defects.seed
    if spec.aircraft is not None:
        unusual["aircraft"] = (
            spec.aircraft.sha256
            if isinstance(spec.aircraft, FileInput)
            else [track.model_dump(mode="json") for track in spec.aircraft]
        )
    if spec.settings != load_settings(preset, altitude_m=spec.settings.altitude_m):
        unusual["settings"] = spec.settings.model_dump(mode="json")
    traffic = spec.traffic
    if traffic.routes or traffic.recording or traffic.take_off_s:
        recording = traffic.recording.sha256 if traffic.recording else ""
        unusual["traffic"] = [recording, traffic.take_off_s, *(route.sha256 for route in traffic.routes)]
    files = [*spec.plugins, *(file for name in policies for file in PolicyInput.of(name).files)]
    if files:
        unusual["files"] = [file.sha256 for file in files]
    every = len(policies) > 1 and set(policies) == set(policy_names())
    name = ALL if every else "+".join(name.rpartition(":")[2] for name in policies)
    plain = f"{name}-{traffic.name}-{spec.settings.altitude_m:g}m-{preset}-seed{spec.seed}"
    mark = sha256(json.dumps(unusual, sort_keys=True).encode()).hexdigest()[:6]
    world = Path(spec.world.path)
    place = world / "missions" if os.access(world, os.W_OK) else Path("missions") / spec.world.name
    return place / (f"{plain}-{mark}" if unusual else plain)

"""The name of a mission's folder where the user gives none."""

import json
from hashlib import sha256

from pavetwin.config import load_settings
from pavetwin.mission.spec import MissionSpec


def folder_name(spec: MissionSpec, policies: str, preset: str, *, usual_targets: bool) -> str:
    """What is asked for most, and a short hash of all that is unusual: `hover-high-1-10m-default-seed1-3f2a9c`.

    Args:
        policies: name of the policy, or of several.
        usual_targets: whether the targets follow from the seed alone.
    """
    unusual: dict[str, object] = {}
    if not usual_targets:
        unusual["targets"] = spec.targets
    if spec.defects.seed is not None:
        unusual["defect_seed"] = spec.defects.seed
    if spec.aircraft is not None:
        unusual["aircraft"] = spec.aircraft.sha256
    if spec.settings != load_settings(preset, altitude_m=spec.settings.altitude_m):
        unusual["settings"] = spec.settings.model_dump(mode="json")
    traffic = spec.traffic
    if traffic.routes or traffic.recording or traffic.take_off_s:
        recording = traffic.recording.sha256 if traffic.recording else ""
        unusual["traffic"] = [recording, traffic.take_off_s, *(route.sha256 for route in traffic.routes)]
    name = policies.rpartition(":")[2]
    plain = f"{name}-{traffic.name}-{spec.settings.altitude_m:g}m-{preset}-seed{spec.seed}"
    mark = sha256(json.dumps(unusual, sort_keys=True).encode()).hexdigest()[:6]
    return f"{plain}-{mark}" if unusual else plain

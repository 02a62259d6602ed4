"""PaveTwin: a digital twin for planning UAV pavement inspection over open traffic.

What users need, in one place; each name is loaded when it is first used, so that `import pavetwin` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pavetwin._core import __version__
    from pavetwin.config import MissionSettings, load_settings
    from pavetwin.defects import add_defects
    from pavetwin.errors import PaveTwinError
    from pavetwin.mission import (
        Mission,
        MissionInputs,
        MissionResult,
        MissionSpec,
        choose_targets,
        fly_over,
        load_inputs,
        plan_mission,
        prepare,
        replay_of,
        save_mission,
        totals,
    )
    from pavetwin.mission.fly import fly
    from pavetwin.policies import Policy, policy, policy_names
    from pavetwin.sensing import Sensor, sensor, sensor_names
    from pavetwin.world import BuildOptions, World, build_world, load_world, save_world

_ROOMS = {
    "__version__": "_core",
    "MissionSettings": "config",
    "load_settings": "config",
    "add_defects": "defects",
    "PaveTwinError": "errors",
    "Mission": "mission",
    "MissionInputs": "mission",
    "MissionResult": "mission",
    "MissionSpec": "mission",
    "choose_targets": "mission",
    "fly": "mission",
    "fly_over": "mission",
    "load_inputs": "mission",
    "plan_mission": "mission",
    "prepare": "mission",
    "replay_of": "mission",
    "save_mission": "mission",
    "totals": "mission",
    "Policy": "policies",
    "policy": "policies",
    "policy_names": "policies",
    "Sensor": "sensing",
    "sensor": "sensing",
    "sensor_names": "sensing",
    "BuildOptions": "world",
    "World": "world",
    "build_world": "world",
    "load_world": "world",
    "save_world": "world",
}

__all__ = [
    "BuildOptions",
    "Mission",
    "MissionInputs",
    "MissionResult",
    "MissionSettings",
    "MissionSpec",
    "PaveTwinError",
    "Policy",
    "Sensor",
    "World",
    "__version__",
    "add_defects",
    "build_world",
    "choose_targets",
    "fly",
    "fly_over",
    "load_inputs",
    "load_settings",
    "load_world",
    "plan_mission",
    "policy",
    "policy_names",
    "prepare",
    "replay_of",
    "save_mission",
    "save_world",
    "sensor",
    "sensor_names",
    "totals",
]


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module 'pavetwin' has no attribute '{name}'")
    value = getattr(import_module(f"pavetwin.{_ROOMS[name]}"), name)
    globals()[name] = value
    return value

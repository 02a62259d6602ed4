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

_HOMES = {
    name: home
    for home, names in {
        "_core": "__version__",
        "config": "MissionSettings load_settings",
        "defects": "add_defects",
        "errors": "PaveTwinError",
        "mission": "Mission MissionInputs MissionResult MissionSpec choose_targets fly fly_over load_inputs "
        "plan_mission prepare replay_of save_mission totals",
        "policies": "Policy policy policy_names",
        "sensing": "Sensor sensor sensor_names",
        "world": "BuildOptions World build_world load_world save_world",
    }.items()
    for name in names.split()
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
    if name not in _HOMES:
        raise AttributeError(f"module 'pavetwin' has no attribute '{name}'")
    value = getattr(import_module(f"pavetwin.{_HOMES[name]}"), name)
    globals()[name] = value
    return value

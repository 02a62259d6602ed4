"""PaveTwin: a digital twin for planning UAV pavement inspection over open traffic.

What users need, in one place; each name is loaded when it is first used, so that `import pavetwin` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pavetwin._core import __version__
    from pavetwin.config import MissionSettings, load_settings
    from pavetwin.defects import DefectOptions, add_defects
    from pavetwin.errors import PaveTwinError
    from pavetwin.mission import (
        BatteryLow,
        Captured,
        Mission,
        MissionInputs,
        MissionResult,
        MissionSpec,
        Occluded,
        Timeline,
        Totals,
        choose_targets,
        fly_over,
        load_inputs,
        plan_mission,
        prepare,
        replay_of,
        result_of,
        save_mission,
        totals,
    )
    from pavetwin.mission.fly import fly
    from pavetwin.plugins import load_plugins
    from pavetwin.policies import Displace, GoOn, Policy, Revisit, Wait, load_policy, policy, policy_names
    from pavetwin.sensing import Detections, Frame, Sensor, load_sensor, sensor, sensor_names
    from pavetwin.twin import Snapshot
    from pavetwin.world import BuildOptions, World, build_world, load_world, save_world

_HOMES = {
    name: home
    for home, names in {
        "_core": "__version__",
        "config": "MissionSettings load_settings",
        "defects": "DefectOptions add_defects",
        "errors": "PaveTwinError",
        "mission": "BatteryLow Captured Mission MissionInputs MissionResult MissionSpec Occluded Timeline Totals "
        "choose_targets fly fly_over load_inputs plan_mission prepare replay_of result_of save_mission totals",
        "plugins": "load_plugins",
        "policies": "Displace GoOn Policy Revisit Wait load_policy policy policy_names",
        "sensing": "Detections Frame Sensor load_sensor sensor sensor_names",
        "twin": "Snapshot",
        "world": "BuildOptions World build_world load_world save_world",
    }.items()
    for name in names.split()
}

__all__ = [
    "BatteryLow",
    "BuildOptions",
    "Captured",
    "DefectOptions",
    "Detections",
    "Displace",
    "Frame",
    "GoOn",
    "Mission",
    "MissionInputs",
    "MissionResult",
    "MissionSettings",
    "MissionSpec",
    "Occluded",
    "PaveTwinError",
    "Policy",
    "Revisit",
    "Sensor",
    "Snapshot",
    "Timeline",
    "Totals",
    "Wait",
    "World",
    "__version__",
    "add_defects",
    "build_world",
    "choose_targets",
    "fly",
    "fly_over",
    "load_inputs",
    "load_plugins",
    "load_policy",
    "load_sensor",
    "load_settings",
    "load_world",
    "plan_mission",
    "policy",
    "policy_names",
    "prepare",
    "replay_of",
    "result_of",
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


def __dir__() -> list[str]:
    return __all__

"""Missions: planning, flight, metrics and result files. Imports no renderer and no SUMO."""

from pavetwin._core import BatteryLow, Captured, Occluded
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.fly import fly, fly_over
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.metrics import SegmentMetrics, Totals, totals
from pavetwin.mission.mission import Mission
from pavetwin.mission.planning import choose_targets, plan_mission
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.result import MissionResult, result_of
from pavetwin.mission.saving import save_mission, save_missions
from pavetwin.mission.spec import MissionSpec
from pavetwin.mission.timeline import Timeline

__all__ = [
    "BatteryLow",
    "Captured",
    "Mission",
    "MissionEnvironment",
    "MissionInputs",
    "MissionResult",
    "MissionSpec",
    "Occluded",
    "Replay",
    "SegmentMetrics",
    "Timeline",
    "Totals",
    "choose_targets",
    "fly",
    "fly_over",
    "load_inputs",
    "plan_mission",
    "prepare",
    "replay_of",
    "result_of",
    "save_mission",
    "save_missions",
    "totals",
]

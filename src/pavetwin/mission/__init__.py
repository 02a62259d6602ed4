"""The loop that flies: plan, run, metrics, result files. Imports no renderer and no SUMO."""

from pavetwin._core import BatteryLow, Captured, Occluded
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.fly import MissionResult, fly, fly_over, result_of
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.mission import Mission
from pavetwin.mission.plan import plan_mission
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.results import Totals, save_mission, save_missions, totals
from pavetwin.mission.spec import MissionSpec
from pavetwin.mission.targets import choose_targets
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

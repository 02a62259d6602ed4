"""The loop that flies: plan, run, metrics, result files. Imports no renderer and no SUMO."""

from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.fly import MissionResult, fly
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.mission import Mission
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.results import Totals, save_mission, save_missions, totals
from pavetwin.mission.targets import choose_targets
from pavetwin.mission.timeline import Timeline

__all__ = [
    "Mission",
    "MissionEnvironment",
    "MissionResult",
    "Replay",
    "SegmentMetrics",
    "Timeline",
    "Totals",
    "choose_targets",
    "fly",
    "prepare",
    "replay_of",
    "save_mission",
    "save_missions",
    "totals",
]

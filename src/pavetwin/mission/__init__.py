"""The loop that flies: plan, run, metrics, result files. Imports no renderer and no SUMO."""

from pavetwin.mission.fly import Flown, fly
from pavetwin.mission.ground import Stage, prepare
from pavetwin.mission.ledger import SegmentRow
from pavetwin.mission.mission import Mission
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.results import Totals, save_mission, save_missions, totals
from pavetwin.mission.targets import choose_targets

__all__ = [
    "Flown",
    "Mission",
    "Replay",
    "SegmentRow",
    "Stage",
    "Totals",
    "choose_targets",
    "fly",
    "prepare",
    "replay_of",
    "save_mission",
    "save_missions",
    "totals",
]

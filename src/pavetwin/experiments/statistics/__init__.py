"""The statistics of a study: summaries, paired differences, effects and a recommendation."""

from pavetwin.experiments.statistics.choice import MissionLimits, Objective
from pavetwin.experiments.statistics.effects import effects
from pavetwin.experiments.statistics.paired import Comparison, differences, every_pair
from pavetwin.experiments.statistics.recommend import Recommendation, recommend
from pavetwin.experiments.statistics.summary import summarise

__all__ = [
    "Comparison",
    "MissionLimits",
    "Objective",
    "Recommendation",
    "differences",
    "effects",
    "every_pair",
    "recommend",
    "summarise",
]

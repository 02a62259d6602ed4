"""The statistics of a study: summaries, paired differences, effects, sentences, a recommendation."""

from pavetwin.experiments.statistics.choice import MissionLimits, Objective
from pavetwin.experiments.statistics.effects import effects
from pavetwin.experiments.statistics.key_findings import key_findings
from pavetwin.experiments.statistics.paired import Comparison, differences, every_pair
from pavetwin.experiments.statistics.recommend import Recommendation, recommend
from pavetwin.experiments.statistics.sentences import conclusions
from pavetwin.experiments.statistics.summary import summarise

__all__ = [
    "Comparison",
    "MissionLimits",
    "Objective",
    "Recommendation",
    "conclusions",
    "differences",
    "effects",
    "every_pair",
    "key_findings",
    "recommend",
    "summarise",
]

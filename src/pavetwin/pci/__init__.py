"""The Pavement Condition Index (PCI) by ASTM D6433: of sample units, segments and streets, from their defects."""

from pavetwin.pci.index import Deduct, Rating, pavement_condition_index, rating_of
from pavetwin.pci.survey import (
    MeasuredDefect,
    SampleUnit,
    Survey,
    UnitCondition,
    mean_pci,
    measured_conditions,
    not_counted,
    sample_units,
)

__all__ = [
    "Deduct",
    "MeasuredDefect",
    "Rating",
    "SampleUnit",
    "Survey",
    "UnitCondition",
    "mean_pci",
    "measured_conditions",
    "not_counted",
    "pavement_condition_index",
    "rating_of",
    "sample_units",
]

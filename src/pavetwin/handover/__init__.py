"""Handover of a mission to agency and pilot: one folder with a page, plans, defects and pavement condition."""

from pavetwin.handover.contents import Handover, handover_of
from pavetwin.handover.files import HANDOVER_FILES, check_target, write_handover
from pavetwin.handover.of_study import CHOSEN, StreetAdvice, advice_of, fly_recommended

__all__ = [
    "CHOSEN",
    "HANDOVER_FILES",
    "Handover",
    "StreetAdvice",
    "advice_of",
    "check_target",
    "fly_recommended",
    "handover_of",
    "write_handover",
]

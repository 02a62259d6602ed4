"""How far the severities that a detector gives agree with those that captures know."""

from dataclasses import dataclass

from pavetwin.perception.results.visible_severity import possible_ranks
from pavetwin.training.evaluation.matching import Matched
from pavetwin.training.evaluation.sizes import found_whole
from pavetwin.world.model import Severity


@dataclass(frozen=True, slots=True)
class SeverityAgreement:
    """Over the defects of one class that are found whole."""

    name: str
    """Of the class."""
    defects: int
    right: int
    """One severity was said, and is the true one."""
    within: int
    """Two were said, as `low to medium`, and one of them is the true one."""
    too_low: int
    """What was said is less severe than the true one; of two, both."""
    too_high: int
    not_resolvable: int


def severity_agreements(five: Matched, confidence: float) -> list[SeverityAgreement]:
    """A row for each class with defects whose true and said severity are known, matched at IoU 0.5."""
    order = tuple(Severity)
    rows = []
    for name, pairs in found_whole(five, confidence).items():
        right = within = too_low = too_high = not_resolvable = 0
        for region, said in pairs:
            ranks = possible_ranks(said.severity)
            if ranks is None or not region.severity:
                continue
            true = order.index(Severity(region.severity))
            not_resolvable += not ranks
            right += ranks == (true,)
            within += len(ranks) == 2 and true in ranks
            too_low += bool(ranks) and max(ranks) < true
            too_high += bool(ranks) and min(ranks) > true
        if defects := right + within + too_low + too_high + not_resolvable:
            rows.append(SeverityAgreement(name, defects, right, within, too_low, too_high, not_resolvable))
    return rows

"""How far the severities that a detector gives agree with those that captures know."""

from dataclasses import dataclass

from pavetwin.perception.evaluation.matching import Matched
from pavetwin.perception.evaluation.sizes import is_whole
from pavetwin.perception.results.visible_severity import possible_ranks
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
    regions = {region.number: region for image in five.images for region in image.regions}
    order = tuple(Severity)
    rows = []
    for each in five.classes:
        right = within = too_low = too_high = not_resolvable = 0
        for number, at, told in zip(each.true_number, each.true_found, each.true_confidence, strict=True):
            region = regions[int(number)]
            if at < 0 or told < confidence or not region.severity or not is_whole(region.facts):
                continue
            ranks = possible_ranks(five.found[int(at)].severity)
            if ranks is None:
                continue
            true = order.index(Severity(region.severity))
            not_resolvable += not ranks
            right += ranks == (true,)
            within += len(ranks) == 2 and true in ranks
            too_low += bool(ranks) and max(ranks) < true
            too_high += bool(ranks) and min(ranks) > true
        if defects := right + within + too_low + too_high + not_resolvable:
            rows.append(SeverityAgreement(each.name, defects, right, within, too_low, too_high, not_resolvable))
    return rows

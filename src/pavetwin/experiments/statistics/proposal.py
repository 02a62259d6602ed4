"""A recommendation in sentences: what to fly, how sure that is, and what else there is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, log10
from typing import Final

import polars as pl

from pavetwin.experiments.metrics import BATTERIES, INDEX_ERROR, metric_named
from pavetwin.experiments.statistics.cells import levels_of, varied_columns
from pavetwin.experiments.statistics.choice import (
    ALTITUDE,
    COVERAGE,
    SAME,
    TIME,
    MissionLimits,
    Objective,
    Row,
    nearest_of,
)
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.tours import SEGMENTS, is_by_mission
from pavetwin.experiments.words import amount, factor_name, level_name, setting, span
from pavetwin.reports.words import counted, listed, percent, probability

_SHOWN: Final = 0.05
"""Below this p a difference counts as shown."""
FEW_DEFECTS: Final = 100
"""Fewer leave an interval of a coverage of 85 % wider than 15 percentage points, even where they are independent."""
_SURE: Final = 0.95
"""Probability of keeping the limits below which an option that keeps them with more is named."""


@dataclass(frozen=True)
class _Words:
    """How an objective is spoken of."""

    better: str
    """What would be chosen instead if it kept the limits."""
    leads: str = "leads"
    compared: str = ""
    """In what the replicates compare options."""
    level: str = "found as much; the choice is by time, then by energy"
    """What is said of options that are level in what decides."""


_SPOKEN: Final[Mapping[Objective, _Words]] = {
    Objective.MOST_FOUND: _Words("better option"),
    Objective.HIGHEST: _Words("higher option", level="too; the choice at this altitude is by coverage, then by time"),
    Objective.FASTEST: _Words(
        "faster option", "is the fastest", " in time", "took as long; the choice is by coverage, then by energy"
    ),
    Objective.LEAST_ENERGY: _Words(
        "option of less energy",
        "takes the least energy",
        " in energy",
        "took as much energy; the choice is by coverage, then by time",
    ),
    Objective.MOST_ACCURATE_INDEX: _Words(
        "option with a smaller error of the index",
        "has the smallest error of the index",
        " in this error",
        "errs as much; the choice is by coverage, then by time",
    ),
}


def proposal(
    table: pl.DataFrame, options: Sequence[Row], by: Sequence[str], limits: MissionLimits, objective: Objective
) -> list[str]:
    """Of the first of the options, which is the best."""
    best, *others = options
    measured = listed([f"{metric_named(name).label.lower()} {_mean(best, name)}" for name in objective.judged])
    return [
        f"fly {_option(best, by)}: mean {measured} {_of_what(table)}",
        *_rests_on(best),
        *_batteries(best),
        *_lead(best, others, by, limits, objective),
        *_beyond(best, others, by, limits, objective),
        *_corrected(options, limits, objective),
        *_likelier(best, others, by, limits),
        *_warnings(best, limits),
        *_surer(best, others, by, limits, objective),
        *_left_out(others, by),
        *_averaged(table, by),
    ]


def _of_what(table: pl.DataFrame) -> str:
    """What time and energy are of."""
    if not is_by_mission(table):
        return "a segment, the flight from the base included"
    return f"a mission over {_segments(table)}, the way out and home included"


def _segments(table: pl.DataFrame) -> str:
    """`19 segments`, `17 to 19 segments`."""
    counts = sorted(table[SEGMENTS].unique().to_list())
    words = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return f"{words} segment{'s' * (counts != [1])}"


def _rests_on(best: Row) -> list[str]:
    """How many defects the coverage is a share of."""
    if best["defects"] is None:
        return []
    few = ", so few that its interval is wide" if best["defects"] < FEW_DEFECTS else ""
    return [
        f"the coverage rests on {counted(best['defects'], 'defect')} in "
        f"{counted(best['coverage_replicates'], 'replicate')}{few}"
    ]


def _batteries(best: Row) -> list[str]:
    """How many to bring to a tour: enough for 95 % of the missions; each is changed above its reserve."""
    if best.get(BATTERIES) is None:
        return []
    bring = batteries_to_bring(best)
    mean = amount(metric_named(BATTERIES), best[BATTERIES])
    return [
        f"bring {bring} batter{'y' if bring == 1 else 'ies'}: a mission took {mean} on average, {bring} at the 95th "
        "percentile, each changed in time to be home with its reserve"
    ]


def batteries_to_bring(option: Row) -> int:
    """Full batteries that are enough for 95 % of the missions of an option."""
    return ceil(float(option[f"{BATTERIES}_p95"]) - SAME)


def _corrected(options: Sequence[Row], limits: MissionLimits, objective: Objective) -> list[str]:
    """What is left of the means once it is allowed for that they were chosen, and how likely the choice is right."""
    best, rivals = options[0], [other for other in options[1:] if other["certainty"] is not None]
    if best["certainty"] is None or not rivals:
        return []
    coverage, sure = _expected(best, COVERAGE), percent(best["certainty"])
    if objective is Objective.MOST_FOUND:
        return [
            f"corrected for its choice as the best of {len(rivals) + 1}, its coverage is expected at {coverage}, and "
            f"it is the best with a probability of {sure}"
        ]
    decides = objective.order[0]
    cost = ""
    if decides != ALTITUDE:
        cost = f" and its {metric_named(decides).label.lower()} at {_expected(best, decides)}"
    return [
        f"corrected for its choice among {len(rivals) + 1}, its coverage is expected at {coverage}{cost}; with a "
        f"probability of {sure} it keeps {limits.words} and no {_SPOKEN[objective].better} does"
    ]


def _likelier(best: Row, others: Sequence[Row], by: Sequence[str], limits: MissionLimits) -> list[str]:
    """Another option that the table says to be the best with a higher probability, and why it is not proposed."""
    rivals = [other for other in others if other["certainty"] is not None]
    if best["certainty"] is None or not rivals:
        return []
    likeliest = max(rivals, key=lambda other: float(other["certainty"]))
    if round(likeliest["certainty"], 2) <= round(best["certainty"], 2):
        return []
    kept = f" and for how surely an option keeps {limits.words}" if limits.named else ""
    return [
        f"{_option(likeliest, by)} is the best with a higher probability, {percent(likeliest['certainty'])}: the "
        f"proposal follows the means of what was flown, the probability allows for their random errors{kept}"
    ]


def _expected(option: Row, name: str) -> str:
    return amount(metric_named(name), option[f"{name}_expected"])


def _lead(
    best: Row, others: Sequence[Row], by: Sequence[str], limits: MissionLimits, objective: Objective
) -> list[str]:
    """Which options the replicates separate from the best: by what decides, compared in pairs, p not corrected."""
    rivals, count = [other for other in others if other["feasible"]], best["replicates"]
    if not rivals and any(other["unmeasured"] for other in others):
        return []
    if not rivals:
        return [f"no other option keeps {limits.words}" if limits.named and others else "there is no other option"]
    if count < FEW:
        replicates = "one replicate is" if count == 1 else f"{count} replicates are"
        return [f"{replicates} too few to separate options: fly at least {FEW}"]
    words, decides = _SPOKEN[objective], objective.order[0]
    if objective is Objective.HIGHEST:
        as_high = [_option(other, by) for other in rivals if other[ALTITUDE] == best[ALTITUDE]]
        keep = f"{'keep' if len(as_high) > 1 else 'keeps'} {limits.words}"
        return [f"{_first(as_high)} {keep} {words.level}"] if as_high else []
    level = [other for other in rivals if _printed(other, decides) == _printed(best, decides)]
    same = [_option(other, by) for other in level if other["same"]]
    dearer = [_option(other, by) for other in level if not other["same"]]
    apart = [other for other in rivals if other not in level and other["p"] is not None]
    close = [f"{_option(other, by)} ({probability(other['p'])})" for other in apart if other["p"] >= _SHOWN]
    leads = f"{f'within {limits.words}, ' if limits.named else ''}{_option(best, by)} {words.leads}"
    count = min(count, *(other["replicates"] for other in rivals))
    sentences = []
    if close:
        sentences.append(f"{leads}; {count} replicates cannot separate it{words.compared} from {_first(close)}")
    elif apart:
        rest = _first([_option(other, by) for other in apart])
        sentences.append(
            f"{leads}; {count} replicates separate it{words.compared} from {rest} (each p < {_SHOWN:g}, not corrected)"
        )
    if same:
        sentences.append(f"{_first(same)} {'are' if len(same) > 1 else 'is'} the same in everything")
    if dearer:
        sentences.append(f"{_first(dearer)} {words.level}")
    return sentences


def _printed(option: Row, name: str) -> float:
    """A mean, rounded as it is printed."""
    metric = metric_named(name)
    return round(float(option[name]), metric.digits + round(log10(metric.scale)))


def _beyond(
    best: Row, others: Sequence[Row], by: Sequence[str], limits: MissionLimits, objective: Objective
) -> list[str]:
    """Which option would be chosen instead if it broke no limit. Of the most found, `_lead` speaks of the others."""
    if objective is Objective.MOST_FOUND:
        return []
    decides, better = objective.order[0], _SPOKEN[objective].better
    sign = -1.0 if objective is Objective.HIGHEST else 1.0
    ahead = [other for other in others if other[decides] is not None and sign * other[decides] < sign * best[decides]]
    nearest, broken = nearest_of(ahead, limits)
    if nearest is None or broken is None:
        return [f"no {better} was flown"] if not ahead and not any(other["unmeasured"] for other in others) else []
    return [f"no {better} keeps {limits.words} on average: the nearest is {_broken(nearest, broken, by, limits)}"]


def _broken(option: Row, broken: str, by: Sequence[str], limits: MissionLimits) -> str:
    """`hover at 30 m, whose coverage, 16.7 % (13.1 to 20.2), is below 25.0 %`."""
    metric, side = metric_named(broken), "below" if broken == COVERAGE else "above"
    found = "" if broken == COVERAGE else f" (coverage {amount(metric_named(COVERAGE), option[COVERAGE])})"
    return (
        f"{_option(option, by)}{found}, whose {metric.label.lower()}, {_mean(option, broken)}, is {side} "
        f"{amount(metric, limits.named[broken])}"
    )


def _warnings(best: Row, limits: MissionLimits) -> list[str]:
    unsure = limits.named and best["kept"] is not None and best["kept"] < _SURE
    late = limits.max_time_s is not None and best["time_s_p95"] > limits.max_time_s
    p95 = amount(metric_named(TIME), best["time_s_p95"])
    warnings = (
        (
            unsure,
            f"its true means may break {limits.words}: with a probability of {percent(1 - (best['kept'] or 0.0))}",
        ),
        (late, f"the limit of time holds for the mean, not for every mission: the 95th percentile is {p95}"),
        (best["failed"], f"{best['failed']} of its missions failed, as with every option, and are in no mean"),
        (best["undefined"], f"{best['undefined']} of its missions had no defects to find, and no coverage"),
    )
    return [warning for applies, warning in warnings if applies]


def _surer(
    best: Row, others: Sequence[Row], by: Sequence[str], limits: MissionLimits, objective: Objective
) -> list[str]:
    """Where the best may well break the limits, as one chosen for keeping them just so, the best that hardly can."""
    if objective is Objective.MOST_FOUND or best["kept"] is None or best["kept"] >= _SURE:
        return []
    safe = [other for other in others if other["feasible"] and other["kept"] >= _SURE]
    return [
        f"{_option(option, by)} keeps {limits.words} with a probability of {percent(option['kept'])}"
        for option in safe[:1]
    ]


def _left_out(options: Sequence[Row], by: Sequence[str]) -> list[str]:
    """The options that failed where others did not, and those of which too little was measured."""
    failed = [
        f"{_option(option, by)} ({option['failed_alone']} failed)" for option in options if option["failed_alone"]
    ]
    unmeasured = [
        f"{_option(option, by)} ({option['replicates'] or 'none'})"
        for option in options
        if option["unmeasured"] and not option["failed_alone"]
    ]
    said = [f"left out, since their means lack missions that others flew: {_first(failed)}"] if failed else []
    if unmeasured:
        said.append(
            "left out, since too few of their replicates have a condition index by what was detected: "
            f"{_first(unmeasured)}"
        )
    return said


def _averaged(table: pl.DataFrame, by: Sequence[str]) -> list[str]:
    """What else the design varies, over which the means are taken."""
    levels = {name: levels_of(table, name) for name in varied_columns(table) if name not in by}
    named = [
        f"{factor_name(name)} ({listed([level_name(level) for level in found])})"
        for name, found in levels.items()
        if len(found) > 1
    ]
    return [f"this is an average over {listed(named)}"] if named else []


def _first(named: Sequence[str]) -> str:
    """The first three, and how many more there are."""
    return listed(named) if len(named) <= 3 else f"{', '.join(named[:3])} and {len(named) - 3} more"


def _option(option: Row, by: Sequence[str]) -> str:
    """`hover at 10 m`: the policy first, as one would say it."""
    rest = [column for column in by if column != "policy"]
    return " ".join([str(option["policy"])] * ("policy" in by) + [setting(option, rest)] * bool(rest))


def _mean(option: Row, name: str) -> str:
    metric, low, high = metric_named(name), option[f"{name}_low"], option[f"{name}_high"]
    interval = f" ({span(metric, low, high)})" if low is not None else ""
    return amount(metric, option[name]) + interval


def refusal(
    options: Sequence[Row],
    by: Sequence[str],
    nearest: Row | None,
    broken: str | None,
    limits: MissionLimits,
    objective: Objective,
) -> list[str]:
    """That no option keeps the limits, and which is the nearest."""
    left = _left_out(options, by)
    if nearest is None or broken is None:
        index = ["a condition index by what was detected"] * (INDEX_ERROR in objective.judged)
        return [f"no option has {listed(['a coverage', 'a time', 'an energy', *index])} to judge by", *left]
    return [f"no option keeps {limits.words} on average: the nearest is {_broken(nearest, broken, by, limits)}", *left]

"""Hours in which nobody may park: a part of OSM's opening hours.

Read are rules of days of the week and times, such as `Mo-Fr 07:00-17:00; Sa 09:00-14:00`, `Mo,We 08:00-12:00`,
`08:00-18:00` and `24/7`. Holidays are days like others. A text with anything else in it does not close a place.
"""

import datetime as dt
import re
from collections.abc import Collection, Iterator
from typing import Final

DAYS: Final = ("Mo", "Tu", "We", "Th", "Fr", "Sa", "Su")

_CONDITION = re.compile(r"\s*(?P<value>[^@;]+?)\s*@\s*(?:\((?P<inside>[^)]*)\)|(?P<plain>[^;()]+))\s*(?:;|$)")
_TIMES = r"\d{1,2}:\d{2}-\d{1,2}:\d{2}"
_RULE = re.compile(
    rf"(?:(?P<days>[A-Z][a-z](?:-[A-Z][a-z])?(?:,\s*[A-Z][a-z](?:-[A-Z][a-z])?)*)\s*)?(?P<times>{_TIMES}(?:,\s*{_TIMES})*)?"
)

HoursRule = tuple[frozenset[int], tuple[tuple[int, int], ...]]
"""Days of the week, 0 Monday, and spans of minutes of the day."""


def conditional_hours(conditions: str, values: Collection[str]) -> str:
    """The hours in which one of `values` holds in a conditional tag such as `no_parking @ (Mo-Fr 08:00-16:00)`.

    Hours that cannot be read are left out.
    """
    found = [
        (match["inside"] or match["plain"] or "").strip()
        for match in _CONDITION.finditer(conditions)
        if match["value"] in values
    ]
    return "; ".join(hours for hours in found if hours and _rules(hours) is not None)


def is_within(hours: str, date: dt.date, time: dt.time) -> bool:
    """Whether a moment lies in hours; never in empty ones and in ones that cannot be read."""
    minute = time.hour * 60 + time.minute
    return any(
        date.weekday() in days and any(_in_span(minute, start, end) for start, end in spans)
        for days, spans in _rules(hours) or ()
    )


def _in_span(minute: int, start: int, end: int) -> bool:
    return start <= minute < end if start < end else minute >= start or minute < end


def _rules(hours: str) -> list[HoursRule] | None:
    """None where a part of it is not understood."""
    rules: list[HoursRule] = []
    for part in filter(None, (part.strip() for part in hours.split(";"))):
        match = _RULE.fullmatch(part)
        if part == "24/7":
            rules.append((frozenset(range(7)), ((0, 1440),)))
            continue
        if match is None:
            return None
        days = _days(match["days"] or "Mo-Su")
        if days is None:
            return None
        rules.append((days, tuple(_spans(match["times"] or "00:00-24:00"))))
    return rules


def _days(text: str) -> frozenset[int] | None:
    days: set[int] = set()
    for part in text.replace(" ", "").split(","):
        first, _, last = part.partition("-")
        if first not in DAYS or (last and last not in DAYS):
            return None
        start, end = DAYS.index(first), DAYS.index(last or first)
        days.update((start + step) % 7 for step in range((end - start) % 7 + 1))
    return frozenset(days)


def _spans(text: str) -> Iterator[tuple[int, int]]:
    for part in text.replace(" ", "").split(","):
        start, end = (int(clock[:-3]) * 60 + int(clock[-2:]) for clock in part.split("-"))
        yield start, end

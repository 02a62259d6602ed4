"""`--date`, `--time`, `--clouds` and `--wind`."""

from typing import Any

import pytest

from pavetwin.cli.conditions import conditions_of
from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError


@pytest.mark.parametrize(
    ("wind", "mps", "from_deg"), [("5@90", 5.0, 90.0), ("5", 5.0, 270.0), ("2.5@0", 2.5, 0.0), ("0", 0.0, 270.0)]
)
def test_the_options_become_conditions(wind: str, mps: float, from_deg: float) -> None:
    given = conditions_of("2026-06-21", "09:30", 0.4, wind)
    ours = load_settings("paper", conditions=given).conditions
    assert (ours.date.isoformat(), ours.time.isoformat(), ours.clouds) == ("2026-06-21", "09:30:00", 0.4)
    assert (ours.wind_mps, ours.wind_from_deg) == (mps, from_deg)


def test_what_is_not_given_stays_as_the_preset_has_it() -> None:
    assert conditions_of(None, None, None, None) == {}
    assert load_settings(conditions=conditions_of(None, None, None, "5")).conditions.clouds == 0.1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"date": "2026-02-30"}, "--date 2026-02-30: expected a date of the calendar, such as 2026-06-21."),
        ({"date": "1066-10-14"}, "--date 1066-10-14: expected a date from 1950 to 2050."),
        ({"time": "25:00"}, "--time 25:00: expected a time of day without a time zone, such as 09:30."),
        ({"clouds": 40.0}, "--clouds 40.0: it must be less than or equal to 1."),
        ({"wind": "5@400"}, "--wind 5@400: it must be less than 360."),
        ({"wind": "west"}, "--wind west: expected metres a second, or with the direction it comes from, as in 5@270."),
        ({"wind": "-5"}, "--wind -5: expected metres a second"),
    ],
)
def test_what_does_not_fit_is_said_by_its_option(options: dict[str, Any], words: str) -> None:
    with pytest.raises(PaveTwinError) as refusal:
        conditions_of(**{"date": None, "time": None, "clouds": None, "wind": None, **options})
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)

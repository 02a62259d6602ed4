"""Conditions: when and in what weather, and what is refused."""

import datetime as dt

import pytest

from pavetwin.config import Conditions, MissionSettings, load_settings
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_the_default_is_a_calm_morning_at_the_equinox(preset: str) -> None:
    ours = load_settings(preset).conditions
    assert (ours.date, ours.time) == (dt.date(2025, 3, 20), dt.time(10))
    assert (ours.clouds, ours.turbidity, ours.wind_mps, ours.wind_from_deg) == (0.1, 3.0, 0.0, 270.0)


@pytest.mark.parametrize(
    ("longitude_deg", "utc"), [(0.0, "10:30:00"), (15.0, "09:30:00"), (-74.0, "15:26:00"), (13.4, "09:36:24")]
)
def test_the_time_is_mean_solar_time(longitude_deg: float, utc: str) -> None:
    ours = Conditions(date=dt.date(2026, 6, 21), time=dt.time(10, 30))
    assert ours.utc(longitude_deg).isoformat() == f"2026-06-21T{utc}+00:00"


def test_the_day_in_utc_may_be_another() -> None:
    assert Conditions(date=dt.date(2026, 6, 21), time=dt.time(8)).utc(150.0).date() == dt.date(2026, 6, 20)


@pytest.mark.parametrize(
    ("from_deg", "east", "north"), [(270.0, 3.0, 0.0), (90.0, -3.0, 0.0), (0.0, 0.0, -3.0), (180.0, 0.0, 3.0)]
)
def test_wind_blows_away_from_where_it_comes(from_deg: float, east: float, north: float) -> None:
    assert Conditions(wind_mps=3.0, wind_from_deg=from_deg).wind_velocity_mps == pytest.approx((east, north))


@pytest.mark.parametrize("time", ["09:30", "10:30", "10:30:15"])
def test_a_time_is_read_as_it_is_written(time: str) -> None:
    """YAML 1.1 would take 10:30 for 630."""
    expected = dt.time.fromisoformat(time)
    assert load_settings(overrides=[f"conditions.time={time}"]).conditions.time == expected
    values = parse_yaml(f"conditions: {{time: {time}, date: 2026-06-21}}", where="here")
    assert MissionSettings.parse(values, where="here").conditions == Conditions(
        time=expected, date=dt.date(2026, 6, 21)
    )


def test_written_settings_are_read_back() -> None:
    ours = load_settings(overrides=["conditions.time=10:30:15", "conditions.date=2026-06-21"])
    assert MissionSettings.parse(ours.model_dump(mode="json"), where="here") == ours


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("conditions.date=2026-02-30", "conditions.date: expected a date of the calendar, such as 2026-06-21"),
        ("conditions.date=2026", "conditions.date: expected a date of the calendar"),
        ("conditions.date=2026-06-21 10:00", "conditions.date: expected a date of the calendar"),
        ("conditions.date=1066-10-14", "conditions.date: expected a date from 1950 to 2050"),
        ("conditions.time=25:00", "conditions.time: expected a time of day without a time zone, such as 09:30"),
        ("conditions.time=10", "conditions.time: expected a time of day"),
        ("conditions.time=10:30Z", "conditions.time: expected a time of day without a time zone"),
        ("conditions.clouds=40", "conditions.clouds"),
        ("conditions.wind_mps=-1", "conditions.wind_mps"),
    ],
)
def test_what_does_not_fit_is_refused(override: str, words: str) -> None:
    with pytest.raises(PaveTwinError) as refusal:
        load_settings(overrides=[override])
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)

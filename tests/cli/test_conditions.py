"""`--date`, `--time`, `--clouds`, `--wind` and `--parking`."""

import pytest
import yaml

from scenes.command_line import pavetwin, plain_refusal


@pytest.mark.parametrize(
    ("wind", "mps", "from_deg"), [("5@90", 5.0, 90.0), ("5", 5.0, 270.0), ("2.5@0", 2.5, 0.0), ("0", 0.0, 270.0)]
)
def test_the_options_become_conditions(wind: str, mps: float, from_deg: float) -> None:
    options = ("--date", "2026-06-21", "--time", "10:30", "--clouds", "0.4", "--wind", wind)
    settings = yaml.safe_load(pavetwin("fly", *options, "--settings").stdout)
    expected = {"date": "2026-06-21", "time": "10:30:00", "clouds": 0.4, "wind_mps": mps, "wind_from_deg": from_deg}
    assert settings["conditions"] == {**expected, "gust_factor": 1.0, "temperature_c": 20.0, "turbidity": 3.0}


def test_conditions_that_are_not_given_are_those_of_the_preset() -> None:
    settings = yaml.safe_load(pavetwin("fly", "--wind", "5", "--settings").stdout)
    assert settings["conditions"]["clouds"] == 0.1


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--date", "2026-02-30"), "--date: expected a date of the calendar, such as 2026-06-21"),
        (("--date", "1066-10-14"), "--date: expected a date from 1950 to 2050"),
        (("--time", "25:00"), "--time: expected a time of day without a time zone, such as 09:30"),
        (("--clouds", "40"), "--clouds: it must be less than or equal to 1 (got 40)"),
        (("--wind", "5@400"), "--wind: it must be less than 360"),
        (("--wind", "west"), "--wind: expected metres per second, optionally with the direction it comes from"),
        (("--wind=-5",), "--wind: expected metres per second"),
        (("--parking", "1.5"), "--parking: expected a share of the places (0 to 1)"),
        (("--parking", "few"), "--parking: expected a share of the places (0 to 1)"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_option(options: tuple[str, ...], line: str) -> None:
    assert plain_refusal(pavetwin("fly", *options, "--settings")).startswith(f"Error: {line}")


@pytest.mark.parametrize(
    ("options", "enabled", "occupancy"),
    [
        ((), True, None),
        (("--parking", "by-time"), True, None),
        (("--preset", "paper"), False, None),
        (("--parking", "none"), False, None),
        (("--preset", "paper", "--parking", "0.9"), True, 0.9),
    ],
)
def test_vehicles_park_unless_that_is_turned_off(
    options: tuple[str, ...], enabled: bool, occupancy: float | None
) -> None:
    settings = yaml.safe_load(pavetwin("fly", *options, "--settings").stdout)
    assert settings["parking"] == {"enabled": enabled, "occupancy": occupancy}

"""`pavetwin aircraft`, and `--aircraft` of `fly`."""

from pathlib import Path

from pavetwin.uav import AIRCRAFT
from scenes.command_line import pavetwin, plain_refusal


def test_the_list_names_every_aircraft_with_its_makers_times() -> None:
    said = pavetwin("aircraft", "list").stdout
    assert all(name in said for name in AIRCRAFT.names())
    assert all(profile.title in said for profile in AIRCRAFT.values())
    (mavic,) = (line for line in said.splitlines() if line.startswith("mavic3e"))
    assert mavic.split()[-5:] == ["0.92", "45", "38", "12", "2.7"]


def test_one_aircraft_is_shown_with_its_sources_and_its_power() -> None:
    said = pavetwin("aircraft", "show", "phantom4pro").stdout
    assert "DJI Phantom 4 Pro specifications" in said
    assert said.split()[-3:] == ["20", "432", "42.0"]


def test_an_unknown_aircraft_is_one_plain_line_with_the_nearest() -> None:
    assert "did you mean 'mavic3e'?" in plain_refusal(pavetwin("aircraft", "show", "mavic3"))
    line = plain_refusal(pavetwin("fly", "--settings", "--aircraft", "phantom4prp"))
    assert line.startswith("Error: --aircraft: no aircraft 'phantom4prp' (did you mean 'phantom4pro'?)")


def test_fly_takes_an_aircraft_by_name_and_refuses_wind_above_its_limit(tmp_path: Path) -> None:
    assert "aircraft: phantom4\n" in pavetwin("fly", "--settings", "--aircraft", "phantom4").stdout
    windy = ("fly", "--settings", "--aircraft", "phantom4", "--wind")
    assert "above the 10 m/s that the DJI Phantom 4 is rated for" in plain_refusal(pavetwin(*windy, "10.5"))
    assert pavetwin(*windy, "10").returncode == 0
    (tmp_path / "own.yaml").write_text("mine: {mass_kg: 1}", encoding="utf-8")
    line = plain_refusal(pavetwin("fly", "--settings", "--aircraft", tmp_path / "own.yaml"))
    assert "own.yaml, aircraft 'mine': title: Field required" in line

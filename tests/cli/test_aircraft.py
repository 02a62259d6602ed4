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


def test_the_list_marks_what_no_maker_states() -> None:
    """DJI states no hover of the Phantoms, and of the Matrice 350 no time with the P1."""
    said = pavetwin("aircraft", "list").stdout
    assert "~: time of the model" in said
    marked = {line.split()[0]: [f for f in line.split() if f.startswith("~")] for line in said.splitlines() if line}
    assert marked["phantom4pro"] == ["~27"]
    assert len(marked["matrice350"]) == 2
    assert marked["mavic3e"] == marked["mavic2pro"] == marked["matrice4e"] == []


def test_one_aircraft_is_shown_with_what_is_its_makers_and_what_the_models(tmp_path: Path) -> None:
    makers, models = pavetwin("aircraft", "show", "phantom4pro").stdout.split("# The model's, from these")
    assert "flight_time_min: 30" in makers
    assert "hover: 27 min (predicted" in models
    assert "assumed: blade tips at 120 m/s" in models
    assert "hover:" not in pavetwin("aircraft", "show", "mavic3e").stdout
    plain = (Path(__file__).parents[2] / "src/pavetwin/uav/aircraft.yaml").read_text(encoding="utf-8")
    (tmp_path / "own.yaml").write_text(plain.replace("  tilt_deg: 42\n", ""), encoding="utf-8")
    assert "0.03 of the rotors' discs, assumed" in pavetwin("aircraft", "show", f"{tmp_path}/own.yaml:phantom4").stdout


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
    assert plain_refusal(pavetwin(*windy, "10.5")).startswith("Error: --wind: a wind of 10.5 m/s is above")
    assert pavetwin(*windy, "10").returncode == 0
    (tmp_path / "own.yaml").write_text("mine: {mass_kg: 1}", encoding="utf-8")
    line = plain_refusal(pavetwin("fly", "--settings", "--aircraft", tmp_path / "own.yaml"))
    assert "own.yaml, aircraft 'mine': title: it must be given" in line


def test_what_is_shown_is_a_file_of_the_same_aircraft(tmp_path: Path) -> None:
    said = pavetwin("aircraft", "show", "matrice350").stdout
    own = tmp_path / "own.yaml"
    own.write_text(said, encoding="utf-8")
    assert pavetwin("aircraft", "show", f"{own}:matrice350").stdout == said

"""The choices of a mission.yaml: the page asks for the same mission, and takes no path, code or other file from it."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from pavetwin.app import described
from pavetwin.app.described import LARGEST, choices_of
from pavetwin.app.flight_request import FlightRequest
from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.planning import plan_mission
from pavetwin.mission.spec import MissionSpec
from pavetwin.world.store import load_world


@pytest.fixture(scope="module")
def spec(world: Path) -> MissionSpec:
    """A mission with a choice of each kind that the form has."""
    conditions = {"date": "2026-06-21", "time": "18:30", "clouds": 0.4, "wind_mps": 3.0, "wind_from_deg": 90.0}
    given = {"altitude_m": 12.5, "aircraft": "phantom4pro", "sensing": {"sensor": "ideal"}, "conditions": conditions}
    settings = load_settings("default", (), **given)
    return plan_mission(
        load_world(world), settings, density="los-D+south_asia", segments=["s0003", "s0001"], policy="skip", seed=7
    )


def chosen(world: Path, values: dict[str, Any]) -> dict[str, Any]:
    return choices_of({"text": yaml.safe_dump(values), "worlds": {"w0": str(world)}})


def test_the_page_asks_for_the_same_mission(world: Path, spec: MissionSpec) -> None:
    choices = chosen(world, spec.as_values())
    assert choices["world"] == "w0"
    assert choices["left_out"] == []
    assert choices["values"]["time"] == "18:30"
    request = FlightRequest.of(
        {name: value for name, value in choices["values"].items() if name != "policy"}
        | {"policies": [choices["values"]["policy"]], "segments": choices["segments"]}
    )
    again = plan_mission(
        load_world(world),
        request.settings(),
        density=request.density,
        segments=request.segments,
        policy=request.names[0],
        seed=request.seed,
    )
    assert again.as_values() == spec.as_values()


def test_traffic_in_place_of_the_usual_one_is_asked_for_as_usual(world: Path, spec: MissionSpec) -> None:
    values = spec.as_values()
    values["traffic"] |= {"density": "los-D", "instead_of": "los-C"}
    assert "traffic" not in chosen(world, values)["values"]


def test_what_the_form_has_no_field_for_is_named(world: Path, spec: MissionSpec) -> None:
    values = spec.as_values()
    values["settings"]["visibility"]["threshold"] = 0.5
    values["traffic"] |= {"take_off_s": 60.0, "routes": [{"path": "/etc/passwd", "sha256": "0"}]}
    values["base"] = [1.0, 2.0]
    values["plugins"] = [{"path": "/tmp/own.py", "sha256": "0"}]
    left = chosen(world, values)["left_out"]
    assert left == ["routes", "take_off_s", "plugins", "base", "settings.visibility.threshold"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"policy": {"name": "/home/me/own.py:Careful"}}, "a policy of a file, 'own.py:Careful'"),
        ({"settings": {"sensing": {"sensor": "own.py:Eyes"}}}, "a sensor of a file"),
        ({"settings": {"aircraft": "mine.yaml:survey"}}, "aircraft of a file"),
        ({"policy": {"name": "hove"}}, "hover"),
        ({"world": {"name": "../../etc", "path": "/etc"}}, "which the page does not show"),
        ({"targets": ["../x"]}, "inspects '../x'"),
        ({"targets": "all"}, "no list of `targets`"),
        ({"targets": [["s0001"]]}, "no list of `targets`"),
        ({"format": 99}, "reads only format 1"),
        ({"traffic": {"density": "rush.rou.xml"}}, "rush.rou.xml"),
    ],
)
def test_choices_that_do_not_fit_are_refused_in_one_line(
    world: Path, spec: MissionSpec, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(PaveTwinError, match=words) as reported:
        chosen(world, {**spec.as_values(), **changes})
    assert "\n" not in str(reported.value)


def bomb(entry: str) -> str:
    """Nine levels, of which each has the one below nine times."""
    levels = [f"a{level}: &a{level} {entry.format(', '.join([f'*a{level - 1}'] * 9))}" for level in range(1, 9)]
    return "\n".join(["a0: &a0 {x: 1}", *levels, ""])


@pytest.mark.parametrize("entry", ["[{}]", "{{<<: [{}]}}"])
def test_what_names_and_repeats_its_parts_is_refused_unread(
    world: Path, spec: MissionSpec, monkeypatch: pytest.MonkeyPatch, entry: str
) -> None:
    monkeypatch.setattr(described, "parse_yaml", lambda *_: pytest.fail("it was read"))
    text = bomb(entry) + yaml.safe_dump(spec.as_values())
    with pytest.raises(PaveTwinError, match="repeats a part by its name, 'a0'"):
        choices_of({"text": text, "worlds": {"w0": str(world)}})


@pytest.mark.parametrize("text", ["[" * 20_000, "- " * 40_000, "? " * 40_000, "{a: " * 20_000])
def test_what_is_nested_deeply_is_refused_unread(world: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(described, "parse_yaml", lambda *_: pytest.fail("it was read"))
    with pytest.raises(PaveTwinError, match="nested too deeply"):
        choices_of({"text": text, "worlds": {"w0": str(world)}})


ENDLESS = f"0x{'f' * 50_000}"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("seed: 7", f"seed: {ENDLESS}"),
        ("clouds: 0.4", f"clouds: {ENDLESS}"),
        ("clouds: 0.4", f"clouds: -1{':59' * 20_000}"),
        ("altitude_m: 12.5", f"altitude_m: !!int '{ENDLESS}'"),
        ("date: '2026-06-21'", f"date: {ENDLESS}"),
        ("targets:", f"other: [{{? {ENDLESS} : 1}}]\ntargets:"),
        ("name: skip", f"name: {ENDLESS}"),
    ],
)
def test_a_number_that_is_too_long_to_be_written_is_refused(
    world: Path, spec: MissionSpec, before: str, after: str
) -> None:
    text = yaml.safe_dump(spec.as_values())
    assert before in text
    with pytest.raises(PaveTwinError, match="a number in it is above"):
        choices_of({"text": text.replace(before, after, 1), "worlds": {"w0": str(world)}})


@pytest.mark.parametrize("base", [["a", "b"], "ab", [1], [[1], [2]], {"x": 1, "y": 2}, 7])
def test_a_base_that_is_no_place_is_left_out(world: Path, spec: MissionSpec, base: Any) -> None:
    assert "base" in chosen(world, {**spec.as_values(), "base": base})["left_out"]


@pytest.mark.parametrize("text", ["", "{", "- 1", "7", None, 7, "[" * 20_000, "a: !!python/object:os.system x"])
def test_what_is_no_mission_is_refused(world: Path, text: Any) -> None:
    with pytest.raises(PaveTwinError, match=r"mission\.yaml"):
        choices_of({"text": text, "worlds": {"w0": str(world)}})


def test_a_long_text_is_not_even_read(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(described, "parse_yaml", lambda *_: pytest.fail("it was read"))
    with pytest.raises(PaveTwinError, match="a text of up to"):
        choices_of({"text": "a" * (LARGEST + 1), "worlds": {"w0": str(world)}})

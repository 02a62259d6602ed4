"""Settings: presets, overrides, and what is refused in one plain line."""

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from pavetwin.config import MissionSettings, Settings, load_settings, preset_names
from pavetwin.config.settings import overlay, with_overrides
from pavetwin.errors import PaveTwinError


def refused(*overrides: str, preset: str = "default", **given: Any) -> str:
    """The complaint about some settings: always one line."""
    with pytest.raises(PaveTwinError) as caught:
        load_settings(preset, overrides, **given)
    reported = str(caught.value)
    assert "\n" not in reported
    assert reported.strip() == reported != ""
    return reported


def leaves(model: type[BaseModel], path: str = "") -> list[tuple[str, Any]]:
    """Every key of the settings and its default."""
    found: list[tuple[str, Any]] = []
    for name, info in model.model_fields.items():
        inner = info.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            found += leaves(inner, f"{path}{name}.")
        else:
            found.append((path + name, info.get_default(call_default_factory=True)))
    return found


KEYS = leaves(MissionSettings)


def test_presets_are_there_and_differ_as_documented() -> None:
    assert preset_names() == ["default", "paper"]
    default, paper = load_settings(), load_settings("paper")
    assert default == MissionSettings()
    assert (paper.pattern.kind, default.pattern.kind) == ("out_and_back", "boustrophedon")
    assert (paper.sensing.attempts, default.sensing.attempts) == ("first_capture", "every_capture")
    assert (paper.energy.model, default.energy.model) == ("linear", "rotor")
    assert paper.camera.window_rows == pytest.approx(260 / 950)
    assert (paper.camera.window_columns, paper.camera.window_across_per_altitude) == (None, 0.6)
    assert (default.camera.window_rows, default.camera.window_columns) == (0.5, 1.0)
    assert (default.aircraft, default.camera.model) == ("mavic3e", None)
    assert (paper.aircraft, paper.camera.model) == (None, "paper")


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_the_designs_numbers_are_the_defaults(preset: str) -> None:
    s = load_settings(preset)
    assert (s.uav.radius_m, s.uav.inspect_speed_mps or 5.0, s.uav.transit_speed_mps) == (0.5, 5.0, 10.0)
    assert (s.uav.acceleration_mps2, s.uav.yaw_rate_deg_s, s.uav.stopping_distance_m) == (8.0, 45.0, 1.0)
    assert (s.camera.capture_interval_s, s.visibility.interval_s) == (0.6, 0.3)
    assert (s.visibility.threshold, s.visibility.inspected_share, s.visibility.cell_m) == (0.7, 0.95, 0.25)
    assert (s.policy.wait_s, s.policy.max_wait_s, s.policy.max_displacement_m) == (2.0, 300.0, 3.0)
    assert (s.policy.note_spacing_m, s.policy.note_interval_s, s.policy.revisit_stay_s) == (1.5, 2.0, 5.0)
    assert (s.sensing.recall, s.sensing.min_visible_fraction) == (0.840, 0.35)
    assert (s.energy.endurance_s, s.energy.usable, s.energy.reserve, s.energy.health) == (1800.0, 0.8, 0.15, 1.0)


@pytest.mark.parametrize(("key", "default"), KEYS, ids=[key for key, _ in KEYS])
def test_every_key_can_be_given_in_all_three_ways(key: str, default: Any) -> None:
    if key in ("camera.window_columns", "camera.window_across_per_altitude"):
        return  # one needs the other
    if key in ("policy.options", "sensing.options"):
        default = {"greed": 0.5}
    nested: Any = default
    for part in reversed(key.split(".")):
        nested = {part: nested}
    overridden = load_settings("default", [f"{key}={json.dumps(default, default=str)}"])
    assert overridden == load_settings("default", **nested) == MissionSettings.parse(nested, where="here")


@pytest.mark.parametrize("key", [key for key, _ in KEYS])
def test_a_mistyped_key_is_refused_with_the_nearest(key: str) -> None:
    *sections, leaf = key.split(".")
    wrong = leaf[:-2] + leaf[-1] + leaf[-2] if leaf[-1] != leaf[-2] else leaf + "x"
    reported = refused(f"{'.'.join([*sections, wrong])}=1")
    assert f"unknown key '{wrong}'" in reported
    assert f"did you mean '{leaf}'?" in reported
    assert reported.startswith("settings (preset 'default'): ")


def test_a_mistyped_section_is_refused_with_the_nearest() -> None:
    assert "did you mean 'camera'?" in refused("camrea.model=paper")
    assert "unknown key 'wait_s' (did you mean 'policy.wait_s'?)" in refused("wait_s=3")  # its name in a sweep
    reported = refused("zzz=1")
    assert "unknown key 'zzz'" in reported
    assert "altitude_m" in reported


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("altitude_m=0", "altitude_m"),
        ("altitude_m=4.9", "altitude_m: the UAV flies at 5 m or higher"),
        ("altitude_m=121", "altitude_m: the UAV flies at 120 m or lower"),
        ("altitude_m=high", "altitude_m"),
        ("altitude_m=.nan", "altitude_m"),
        ("altitude_m=", "altitude_m"),
        ("visibility.threshold=1.5", "visibility.threshold"),
        ("sensing.recall=84", "sensing.recall"),
        ("sensing.attempts=twice", "sensing.attempts"),
        ("uav=fast", "uav"),
        ("time_step_s=0.5", "time_step_s"),
        ("camera.capture_interval_s=0.61", "camera.capture_interval_s"),
        ("visibility.interval_s=0.02", "visibility.interval_s"),
        ("camera.window_across_per_altitude=0.6", "camera: give exactly one of window_columns"),
        ("policy.options=[1]", "policy.options"),
        ("uav.radius_m=2020-99-99", "uav.radius_m"),
        ("uav.radius_m=[", "uav.radius_m"),
        ("altitude_m.more=1", "altitude_m"),
        ("uav.radius_m=!!python/object:x {}", "uav.radius_m"),
    ],
)
def test_a_bad_value_is_refused_by_its_key(override: str, key: str) -> None:
    assert key in refused(override)


@pytest.mark.parametrize("override", ["altitude_m", "=3", "  =3", "altitude_m 3", ""])
def test_what_is_no_override_is_refused(override: str) -> None:
    assert "expected key=value" in refused(override)


@pytest.mark.parametrize("override", [".=1", "uav.=1", ".radius_m=1", "uav..radius_m=1"])
def test_a_key_with_an_empty_part_is_refused(override: str) -> None:
    assert "unknown key ''" in refused(override)


@pytest.mark.parametrize(
    ("preset", "near"),
    [("papre", "did you mean 'paper'"), ("Default", "did you mean 'default'"), ("", "default, paper")],
)
def test_an_unknown_preset_is_refused(preset: str, near: str) -> None:
    assert near in refused(preset=preset)


def test_overrides_lie_over_given_values_over_the_preset() -> None:
    ours = load_settings("paper", ["uav.radius_m=0.4"], uav={"radius_m": 0.3, "climb_speed_mps": 2})
    assert ours.uav.radius_m == 0.4
    assert ours.uav.climb_speed_mps == 2.0
    assert ours.energy.model == "linear"
    assert ours.camera == load_settings("paper").camera
    assert load_settings("paper", ["altitude_m=6", "altitude_m=7"]).altitude_m == 7


def test_overrides_change_nothing_they_are_given() -> None:
    values = {"uav": {"radius_m": 1.0}, "altitude_m": 3}
    merged = with_overrides(values, ["uav.radius_m=2", "uav.new=1"])
    assert merged == {"uav": {"radius_m": 2, "new": 1}, "altitude_m": 3}
    assert values == {"uav": {"radius_m": 1.0}, "altitude_m": 3}
    assert overlay({"a": {"b": 1, "c": 2}}, {"a": {"b": 3}, "d": 4}) == {"a": {"b": 3, "c": 2}, "d": 4}


def test_files_of_ones_own_are_made_absolute_and_names_stay() -> None:
    """A mission.yaml is flown again from anywhere."""
    given = load_settings("default", ["camera.model=mine/cams.yaml:wide", "sensing.sensor=eyes.py:Keen"])
    assert given.camera.model == f"{Path.cwd() / 'mine' / 'cams.yaml'}:wide"
    assert given.sensing.sensor == f"{Path.cwd() / 'eyes.py'}:Keen"
    assert load_settings("default", ["sensing.sensor=ideal"]).sensing.sensor == "ideal"


def test_an_override_may_hold_an_equals_sign_and_numbers_may_be_written_as_one_likes() -> None:
    assert load_settings("default", ["camera.model=a=b"]).camera.model == "a=b"
    assert load_settings("default", ["altitude_m=1e1"]).altitude_m == 10.0
    assert load_settings("default", [" altitude_m = 12 "]).altitude_m == 12.0


def test_options_of_a_users_own_policy_keep_their_types() -> None:
    ours = load_settings("default", ["policy.options={greed: 0.5, times: 3, kind: slow, eager: true}"])
    assert ours.policy.options == {"greed": 0.5, "times": 3, "kind": "slow", "eager": True}
    assert [type(value) for value in ours.policy.options.values()] == [float, int, str, bool]
    assert load_settings("default", ["policy.options.greed=0.25"]).policy.options == {"greed": 0.25}


def test_settings_survive_the_way_through_plain_values() -> None:
    for preset in preset_names():
        ours = load_settings(preset, ["policy.options={greed: 0.5}"])
        assert MissionSettings.parse(json.loads(ours.model_dump_json()), where="again") == ours


def test_where_it_was_wrong_is_named() -> None:
    class Small(Settings):
        count: int = 1

    with pytest.raises(PaveTwinError, match=r"^world\.yaml: count: .*\(got 'many'\)\.$"):
        Small.parse({"count": "many"}, where="world.yaml")

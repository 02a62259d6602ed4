"""Policies as pure decisions: the rules that all keep, what each answers, and a user's own from a file."""

from dataclasses import replace
from math import inf
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from pavetwin.config import load_settings
from pavetwin.config.mission import PolicySettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.planning import check_names, settings_under
from pavetwin.policies import (
    POLICIES,
    Displace,
    GoOn,
    Hover,
    Policy,
    Revisit,
    Wait,
    check_policy,
    load_policy,
    policy,
    policy_names,
)
from pavetwin.policies.registered import trial_snapshots
from pavetwin.twin import Episode, Note, Occlusion, Snapshot
from scenes.tiny import SCENES

SETTINGS = PolicySettings()
MOMENTS = {case.name: case.snapshot for case in trial_snapshots(SETTINGS)}
HALF_HIDDEN = MOMENTS["a street half hidden"]

OWN = '''
    """A policy of a user's own: waits a little where much is hidden, else comes back."""

    from pavetwin.policies import GoOn, Policy, Revisit, Wait


    class Careful(Policy):
        def decide(self, snapshot):
            occlusion = snapshot.occlusion
            if occlusion is None or occlusion.hidden_place is None:
                return GoOn()
            if occlusion.visibility < 0.3 and occlusion.episode.waited_s < min(6.0, self.settings.max_wait_s):
                return Wait(2.0)
            if snapshot.memory.noted_near(occlusion.hidden_place, 3.0):
                return GoOn()
            return Revisit(occlusion.hidden_place)
'''


def own_file(folder: Path, text: str, name: str = "own.py") -> Path:
    path = folder / name
    path.write_text(dedent(text), encoding="utf-8")
    return path


# The rules.


@pytest.mark.parametrize("name", policy_names())
def test_every_registered_policy_keeps_the_rules(name: str) -> None:
    assert check_policy(lambda settings: load_policy(name, settings)) == []


def test_a_users_own_policy_keeps_the_rules_and_flies(tmp_path: Path) -> None:
    name = f"{own_file(tmp_path, OWN)}:Careful"
    assert check_policy(lambda settings: load_policy(name, settings)) == []
    assert load_policy(name, SETTINGS).name == "Careful"
    ours = SCENES["car_that_leaves"]().fly(name)
    assert ours.policy == "Careful"
    assert {action.action for action in ours.actions} == {"revisit"} or ours.rows[0].wait_s > 0
    assert len(dedent(OWN).strip().splitlines()) < 30


BAD = {
    "random": ("return Displace(0.1 * random.random(), 0.0)", "depend on the snapshot and the settings alone"),
    "coin": (
        "return Displace(0.1, 0.0) if random.random() < 0.5 else GoOn()",
        "depend on the snapshot and the settings alone",
    ),
    "remembers": (
        "self.n = getattr(self, 'n', 0) + 1; return GoOn() if self.n % 7 else Revisit(snapshot.uav.position)",
        "depend on the snapshot and the settings alone",
    ),
    "remembers for all": (
        "MEMORY.append(1); return GoOn() if len(MEMORY) % 5 else Revisit(snapshot.uav.position)",
        "depend on the snapshot and the settings alone",
    ),
    "wrong type": ("return 'wait'", "must be GoOn, Wait, Displace or Revisit"),
    "nothing": ("pass", "must be GoOn, Wait, Displace or Revisit"),
    "a class": ("return GoOn", "must be GoOn, Wait, Displace or Revisit"),
    "fails": ("return Wait(1 / snapshot.occlusion.episode.waited_s)", "it fails: "),
    "no occlusion": ("return Revisit(snapshot.occlusion.hidden_place)", "it fails: AttributeError"),
    "not a number": ("return Displace(float('nan'), 0.0)", "must be finite"),
    "waits for ever": ("return Wait(1.0)", "it has waited"),
    "waits an age": ("return Wait(1e9)", "at most 3600 s"),
    "flies off": ("return Displace(30.0, 0.0)", "max_displacement_m is"),
    "stays": ("return Displace(0.1, 0.0, stay_s=1e7)", "at most 3600 s"),
    "far away": ("return Revisit((1e6, 0.0))", "at most 1000 m away"),
    "mutates the memory": (
        "object.__setattr__(snapshot.memory, 'notes', snapshot.memory.notes + (1,)); return GoOn()",
        "changes the snapshot",
    ),
    "mutates the twin": ("object.__setattr__(snapshot.uav, 'battery', 1.0); return GoOn()", "changes the snapshot"),
    "mutates a table": ("snapshot.memory.confirmed[9] = 1; return GoOn()", "it fails: TypeError"),
    "slow": ("time.sleep(1.1); return GoOn()", "takes longer"),
}


@pytest.mark.parametrize("flaw", BAD)
def test_a_bad_policy_is_caught_when_it_is_loaded(flaw: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body, complaint = BAD[flaw]
    if flaw == "slow":
        monkeypatch.setattr("pavetwin.policies.registered.SLOWEST_S", 0.002)
        body = body.replace("1.1", "0.003")
    path = own_file(
        tmp_path,
        f"""
        import random, time
        from pavetwin.policies import Displace, GoOn, Policy, Revisit, Wait
        MEMORY = []
        class Bad(Policy):
            def decide(self, snapshot):
                {body}
        """,
    )
    with pytest.raises(PaveTwinError) as caught:
        load_policy(f"{path}:Bad", SETTINGS)
    reported = str(caught.value)
    assert complaint in reported
    assert "\n" not in reported
    assert "Bad" in reported
    assert reported.startswith("`policy`: ")


def test_a_policy_that_cannot_be_made_is_caught(tmp_path: Path) -> None:
    text = """
        from pavetwin.policies import GoOn, Policy
        class Undecided(Policy):
            pass
        class Choosy(Policy):
            def __init__(self, settings):
                super().__init__(settings)
                self.factor = settings.options["factor"]
            def decide(self, snapshot):
                return GoOn()
    """
    path = own_file(tmp_path, text)
    with pytest.raises(PaveTwinError, match="cannot be made from its settings: TypeError"):
        load_policy(f"{path}:Undecided", SETTINGS)
    with pytest.raises(PaveTwinError, match="cannot be made from its settings: KeyError"):
        load_policy(f"{path}:Choosy", SETTINGS)


OPTIONS = """
    from pavetwin.policies import GoOn, Policy
    class Patient(Policy):
        default_options = {"patience_s": 20.0, "eager": False}
        def decide(self, snapshot):
            return GoOn()
"""


def test_an_option_of_a_policy_has_its_default_until_it_is_set(tmp_path: Path) -> None:
    name = f"{own_file(tmp_path, OPTIONS)}:Patient"
    assert load_policy(name, SETTINGS).options == {"patience_s": 20.0, "eager": False}
    changed = load_policy(name, PolicySettings(options={"patience_s": 3}))
    assert changed.options == {"patience_s": 3.0, "eager": False}
    assert type(changed.options["patience_s"]) is float


def test_a_built_in_policy_takes_no_options() -> None:
    with pytest.raises(PaveTwinError, match="the policy 'hover' has no option 'patience_s'; it has none"):
        load_policy("hover", PolicySettings(options={"patience_s": 3.0}))


def test_each_of_several_policies_gets_the_options_that_it_has(tmp_path: Path) -> None:
    own = f"{own_file(tmp_path, OPTIONS)}:Patient"
    settings = load_settings("default", ["policy.options.patience_s=3"])
    assert settings_under("hover", ["hover", own], settings).policy.options == {}
    assert settings_under(own, ["hover", own], settings).policy.options == {"patience_s": 3}
    check_names(settings, ["hover", own], 0)
    with pytest.raises(PaveTwinError, match=r"no policy .* has an option 'patience' \(did you mean 'patience_s'"):
        check_names(load_settings("default", ["policy.options.patience=3"]), ["hover", own], 0)


def test_the_check_reports_every_broken_rule_once() -> None:
    class Worst(Policy):
        def decide(self, snapshot: Snapshot) -> Wait:
            return Wait(1e6 + snapshot.time_s)

    reported = check_policy(Worst)
    assert len(reported) == len(set(reported)) > 20
    assert check_policy(Worst) == reported


def test_the_check_reports_settings_read_without_being_named() -> None:
    class Hasty(Hover):
        reads = frozenset({"wait_s"})

    class Changed(Hover):
        pass

    assert check_policy(Hasty) == ["it reads max_wait_s, which its `reads` does not name"]
    assert check_policy(Changed) == []
    assert Changed.reads == Policy.reads >= {"wait_s", "note_spacing_m"}


def test_the_moments_that_policies_are_tried_on_are_many_and_differ() -> None:
    cases = list(trial_snapshots(SETTINGS))
    assert len(cases) == len({case.name for case in cases}) >= 20
    snapshots = [case.snapshot for case in cases]
    assert any(snapshot.occlusion is None for snapshot in snapshots)
    assert any(snapshot.segment is None for snapshot in snapshots)
    assert any(snapshot.agents == () for snapshot in snapshots)
    assert any(snapshot.uav.battery < 0.05 for snapshot in snapshots)
    occluded = [snapshot.occlusion for snapshot in snapshots if snapshot.occlusion is not None]
    assert any(occlusion.hidden_place is None for occlusion in occluded)
    assert any(occlusion.episode.waited_s >= SETTINGS.max_wait_s for occlusion in occluded)
    assert any(snapshot.memory.notes for snapshot in snapshots)


# Names and files.


def test_registered_names_are_known_and_cannot_be_taken() -> None:
    assert policy_names()[:4] == ["baseline", "hover", "micro", "skip"]
    with pytest.raises(ValueError, match="'hover' is registered already"):
        policy("hover")(type("Other", (Policy,), {}))
    with pytest.raises(PaveTwinError, match=r"'hoover'.*did you mean 'hover'"):
        load_policy("hoover", SETTINGS)
    with pytest.raises(PaveTwinError, match="baseline, hover, micro, skip"):
        load_policy("xyzzy", SETTINGS)


@pytest.mark.parametrize(
    ("text", "name", "complaint"),
    [
        (OWN, "own.py:Carefull", "did you mean 'Careful'"),
        (OWN, "own.py:Policy", "breaks a rule|no policy class"),
        (OWN, "own.py:Wait", "no policy class 'Wait'"),
        (OWN, "own.py", "names no class"),
        (OWN, "other.py:Careful", "there is no file"),
        ("def broken(:", "own.py:X", "fails when read: SyntaxError"),
        ("import no_such_module", "own.py:X", "fails when read: ModuleNotFoundError"),
        ("raise SystemExit(3)", "own.py:X", "fails when read: SystemExit"),
        ("raise ValueError('two\\nlines')", "own.py:X", "fails when read: ValueError: two lines"),
    ],
)
def test_a_file_without_the_policy_is_one_plain_line(text: str, name: str, complaint: str, tmp_path: Path) -> None:
    own_file(tmp_path, text)
    with pytest.raises(PaveTwinError, match=complaint) as caught:
        load_policy(str(tmp_path / name), SETTINGS)
    assert "\n" not in str(caught.value)


def test_a_file_can_be_read_twice_even_when_it_registers_its_policy(tmp_path: Path) -> None:
    text = """
        from pavetwin.policies import GoOn, Policy, policy
        @policy("gentle-for-the-test")
        class Gentle(Policy):
            def decide(self, snapshot):
                return GoOn()
    """
    name = f"{own_file(tmp_path, text)}:Gentle"
    assert load_policy(name, SETTINGS).name == load_policy(name, SETTINGS).name == "gentle-for-the-test"
    assert load_policy("gentle-for-the-test", SETTINGS).decide(HALF_HIDDEN) == GoOn()
    POLICIES.restore("gentle-for-the-test", None)


def test_two_files_of_one_name_are_two_policies(tmp_path: Path) -> None:
    text = """
        from pavetwin.policies import GoOn, Policy, Wait
        class Own(Policy):
            def decide(self, snapshot):
                return GoOn()
    """
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first = own_file(tmp_path / "a", text)
    second = own_file(tmp_path / "b", text.replace("return GoOn()", "return GoOn() if snapshot.time_s else GoOn()"))
    one, two = load_policy(f"{first}:Own", SETTINGS), load_policy(f"{second}:Own", SETTINGS)
    assert type(one) is not type(two)
    assert type(one).__module__ != type(two).__module__


def test_a_policy_made_from_a_built_in_one_has_its_own_name(tmp_path: Path) -> None:
    text = """
        from pavetwin.policies import Hover
        class Longer(Hover):
            pass
        class Named(Hover):
            name = "patient"
    """
    path = own_file(tmp_path, text)
    assert load_policy(f"{path}:Longer", SETTINGS).name == "Longer"
    assert load_policy(f"{path}:Named", SETTINGS).name == "patient"
    assert load_policy("hover", SETTINGS).name == "hover"


# Actions.


@pytest.mark.parametrize("seconds", [0.0, -1.0, inf, float("nan")])
def test_a_wait_is_positive(seconds: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        Wait(seconds)
    with pytest.raises(ValueError, match="stay positive"):
        Revisit((0.0, 0.0), stay_s=seconds)


@pytest.mark.parametrize("wrong", [(inf, 0.0, 1.0), (0.0, float("nan"), 1.0), (1.0, 1.0, -0.1), (0.0, 0.0, inf)])
def test_a_displacement_is_finite(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        Displace(*wrong)
    assert Displace(3.0, 4.0).length_m == 5.0


def test_a_revisit_is_somewhere() -> None:
    with pytest.raises(ValueError, match="must be finite"):
        Revisit((inf, 0.0))


# What each decides.


def occluded(snapshot: Snapshot = HALF_HIDDEN, **episode: float) -> Snapshot:
    assert snapshot.occlusion is not None
    return replace(snapshot, occlusion=replace(snapshot.occlusion, episode=Episode(50.0, **episode)))


@pytest.mark.parametrize("moment", MOMENTS)
def test_the_baseline_goes_on_whatever_it_sees(moment: str) -> None:
    assert load_policy("baseline", SETTINGS).decide(MOMENTS[moment]) == GoOn()


@pytest.mark.parametrize(
    ("waited_s", "answer"),
    [(0.0, Wait(2.0)), (298.0, Wait(2.0)), (299.0, Wait(1.0)), (300.0, GoOn()), (301.0, GoOn())],
)
def test_hover_waits_two_seconds_at_a_time_up_to_max_wait(waited_s: float, answer: object) -> None:
    assert load_policy("hover", SETTINGS).decide(occluded(waited_s=waited_s)) == answer


def test_micro_takes_the_shortest_of_the_best_candidates() -> None:
    micro = load_policy("micro", SETTINGS)
    north = micro.decide(MOMENTS["more to see from the north"])
    assert isinstance(north, Displace)
    assert (north.east_m, north.north_m) == pytest.approx((0.0, 3.0))
    south_west = micro.decide(MOMENTS["more to see from the south-west"])
    assert isinstance(south_west, Displace)
    assert south_west.east_m == pytest.approx(south_west.north_m)
    assert south_west.east_m < 0
    assert south_west.length_m == pytest.approx(3.0)
    assert micro.decide(MOMENTS["nothing to gain by moving"]) == GoOn()
    assert micro.decide(MOMENTS["no room to move"]) == GoOn()


def test_micro_of_equals_takes_the_shortest() -> None:
    class Step:
        """All is seen from a metre to the north and beyond."""

        def agents(self) -> tuple[()]:
            return ()

        def predict(self, displacements: np.ndarray) -> np.ndarray:
            return (displacements[:, 1] > 0.9).astype(float)

    answer = load_policy("micro", SETTINGS).decide(replace(HALF_HIDDEN, moment=Step()))
    assert isinstance(answer, Displace)
    assert answer.length_m == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_micro_is_not_moved_by_the_last_digits_of_predicted_shares(seed: int) -> None:
    """Shares of equals, and of a gain that just suffices, in the digits of another processor."""

    class Shares:
        """All candidates show as much, staying a twentieth less."""

        def __init__(self, error: float) -> None:
            self.error = np.random.default_rng(seed).uniform(-error, error, 49)

        def agents(self) -> tuple[()]:
            return ()

        def predict(self, displacements: np.ndarray) -> np.ndarray:
            return np.where(np.arange(len(displacements)), 3 / 20, 2 / 20) + self.error[: len(displacements)]

    micro = load_policy("micro", SETTINGS)
    exact, near = (micro.decide(replace(HALF_HIDDEN, moment=Shares(error))) for error in (0.0, 1e-12))
    assert isinstance(exact, Displace)
    assert exact == near
    assert (exact.east_m, exact.north_m) == tuple(micro.candidates[1])  # type: ignore[attr-defined]


def test_micro_moves_again_only_a_window_further_along() -> None:
    micro, north = load_policy("micro", SETTINGS), MOMENTS["more to see from the north"]
    window_m = north.window_along_m
    assert micro.decide(occluded(north, displacements=1, since_displacement_m=window_m - 0.1)) == GoOn()
    assert isinstance(micro.decide(occluded(north, displacements=1, since_displacement_m=window_m)), Displace)


def test_micro_looks_in_all_directions_no_further_than_d_max() -> None:
    micro = load_policy("micro", PolicySettings(max_displacement_m=2.0))
    candidates = micro.candidates  # type: ignore[attr-defined]
    reach = np.hypot(*candidates.T)
    assert reach[0] == 0.0
    assert reach.max() == pytest.approx(2.0)
    assert (np.diff(reach) >= -1e-12).all()
    outer = candidates[np.isclose(reach, 2.0)]
    angles = np.sort(np.arctan2(outer[:, 1], outer[:, 0]))
    assert np.diff(angles).max() <= np.radians(22.5) + 1e-9


def test_skip_notes_the_hidden_place_and_stays_five_seconds() -> None:
    assert HALF_HIDDEN.occlusion is not None
    place = HALF_HIDDEN.occlusion.hidden_place
    assert place is not None
    assert load_policy("skip", SETTINGS).decide(HALF_HIDDEN) == Revisit(place, stay_s=5.0)
    assert load_policy("skip", PolicySettings(revisit_stay_s=2.5)).decide(HALF_HIDDEN) == Revisit(place, stay_s=2.5)


@pytest.mark.parametrize(
    ("away_m", "before_s", "is_noted"),
    [(1.4, 10.0, False), (1.6, 10.0, True), (50.0, 1.9, False), (50.0, 2.1, True), (0.0, 1000.0, False)],
)
def test_skip_notes_places_apart_in_space_and_time(away_m: float, before_s: float, is_noted: bool) -> None:
    assert HALF_HIDDEN.occlusion is not None
    assert HALF_HIDDEN.occlusion.hidden_place is not None
    east, north = HALF_HIDDEN.occlusion.hidden_place
    note = Note((east - away_m, north), HALF_HIDDEN.time_s - before_s, 5.0)
    answer = load_policy("skip", SETTINGS).decide(replace(HALF_HIDDEN, memory=HALF_HIDDEN.memory.note(note)))
    assert isinstance(answer, Revisit) == is_noted


@pytest.mark.parametrize("name", ["hover", "micro", "skip"])
def test_where_nothing_is_under_inspection_all_go_on(name: str) -> None:
    assert load_policy(name, SETTINGS).decide(MOMENTS["nothing under inspection"]) == GoOn()


def test_skip_goes_on_where_no_agent_hides_anything() -> None:
    nothing = replace(HALF_HIDDEN, occlusion=Occlusion(0.0, None, Episode(1.0)))
    assert load_policy("skip", SETTINGS).decide(nothing) == GoOn()


def test_a_policy_that_fails_in_flight_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "brittle.py"
    file.write_text(
        "from pavetwin.policies import GoOn, Policy\n"
        "class Brittle(Policy):\n"
        "    def decide(self, snapshot):\n"
        "        if snapshot.segment is not None and snapshot.segment.id == 'street':\n"
        "            return {}['never']\n"
        "        return GoOn()\n"
    )
    with pytest.raises(PaveTwinError, match=r"'Brittle' failed .* KeyError: 'never' \(brittle.py, line 5\)") as caught:
        SCENES["parked_car_over_defect"]().fly(f"{file}:Brittle")
    assert "\n" not in str(caught.value)

"""Designs: what they accept, refuse in one line, and make of their factors."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions
from pavetwin.defects import population as populations
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design, placed_at, preset_names, preset_text, read_design
from pavetwin.experiments.planning import load_worlds, plan
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import Plan, cells_of, units_of, world_of_study
from pavetwin.perception.model_file import DEFAULT
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.uav import find_camera
from pavetwin.world.model import World
from pavetwin.world.store import save_world
from scenes import damaged, tiny


def design(**values: object) -> Design:
    return Design.parse({"worlds": ["town"], **values}, where="the design")


def plan_of(made: Design, segments: int = 6) -> Plan:
    """Plan of a design over a world with that many reachable segments."""
    return Plan(made, ("0" * 64,), ("town",), (tuple(range(segments)),), {name: name for name in made.policies})


def test_the_paper_s_study_has_720_missions() -> None:
    made = Design.parse(yaml.safe_load(preset_text("paper", "worlds/town")), where="paper")
    assert plan_of(made).missions == 720
    assert [world.path for world in made.worlds] == ["worlds/town"]
    assert made.presets == ("paper",)
    assert made.defects == DefectOptions(population="paper")


def test_a_design_has_the_settings_of_a_single_mission_by_default() -> None:
    (cell, *_) = cells_of(design(altitudes_m=[6], policies=["hover"]))
    assert cell.settings(design()) == load_settings(altitude_m=6.0)


@pytest.mark.parametrize("name", preset_names())
@pytest.mark.parametrize("world", ["worlds/my town", "yes", "it's: odd #1", "welten/Köln ü"])
def test_the_designs_that_ship_hold_any_world_s_name(name: str, world: str) -> None:
    text = preset_text(name, world)
    assert Design.parse(yaml.safe_load(text), where=name).worlds[0].path == world
    assert world.replace("'", "''") in text  # as it is read, for who edits it


def test_cells_are_every_combination() -> None:
    made = design(sweep={"tau_o": [0.5, 0.9], "energy.model": ["linear", "rotor"]}, sensors=["ideal", "recall"])
    cells = cells_of(made)
    assert len(set(cells)) == len(cells) == 3 * 4 * 2 * 4
    settings = {(cell.altitude_m, cell.sensor, *cell.swept): cell.settings(made) for cell in cells}
    chosen = settings[15.0, "ideal", 0.9, "linear"]
    assert (chosen.altitude_m, chosen.sensing.sensor) == (15.0, "ideal")
    assert (chosen.visibility.threshold, chosen.energy.model) == (0.9, "linear")


def test_settings_that_are_held_reach_every_cell() -> None:
    made = design(set={"policy.max_wait_s": 120, "recall": 0.5})
    assert {cell.settings(made).policy.max_wait_s for cell in cells_of(made)} == {120.0}
    assert {cell.settings(made).sensing.recall for cell in cells_of(made)} == {0.5}


def test_a_world_with_routes_of_its_own_has_one_traffic() -> None:
    made = design(worlds=["a", {"path": "b", "routes": ["x.rou.xml"]}], densities=["low", "high"], replicates=2)
    assert [(unit.world, unit.traffic) for unit in units_of(made)] == [
        *[(0, "low"), (0, "high")] * 2,
        *[(1, "routes")] * 2,
    ]


@given(seed=st.integers(0, 2**40), replicate=st.integers(0, 99))
def test_missions_over_own_routes_take_off_within_their_times(seed: int, replicate: int) -> None:
    worlds = [{"path": "b", "routes": ["x.rou.xml"], "take_off_s": [600, 3000]}]
    made = plan_of(design(worlds=worlds, seed=seed, replicates=replicate + 2))
    assert 600 <= made.take_off_s(made.units[replicate]) <= 3000
    assert len({made.take_off_s(unit) for unit in plan_of(design(worlds=worlds, seed=seed)).units}) > 10


def test_missions_over_own_routes_take_off_after_a_warm_up_by_default(tmp_path: Path) -> None:
    routes = tmp_path / "x.rou.xml"
    trips = "".join(f'<trip id="{at}" depart="{at}" from="a" to="b"/>' for at in (30, 70))
    routes.write_text(f"<routes>{trips}</routes>")
    worlds = [{"path": "b", "routes": [str(routes)]}, {"path": "c"}]
    made = plan_of(design(worlds=worlds, densities=["low"], replicates=2))
    assert [made.take_off_s(unit) for unit in made.units] == [40, 40, 0, 0]


@given(seed=st.integers(0, 2**40), replicate=st.integers(0, 1000), more=st.integers(1, 50))
def test_more_replicates_leave_the_others_as_they_are(seed: int, replicate: int, more: int) -> None:
    few, many = (plan_of(design(seed=seed, replicates=count)) for count in (replicate + 1, replicate + 1 + more))
    assert few.seeds(replicate) == many.seeds(replicate)
    last = [unit for unit in few.units if unit.replicate == replicate][-1]
    assert few.segments(last) == many.segments(last)
    assert few.seeds(replicate) != many.seeds(replicate + 1)


@given(seed=st.integers(0, 1000), count=st.integers(1, 6))
def test_a_mission_s_segments_are_different_ones_and_the_same_in_all_traffic(seed: int, count: int) -> None:
    made = plan_of(design(seed=seed, segments=count, replicates=3))
    for unit in made.units:
        chosen = made.segments(unit)
        assert len(set(chosen)) == len(chosen) == count
        assert chosen == made.segments(made.units[unit.replicate * 3])


def avenue(*names: str) -> World:
    """Streets in a row, one segment each."""
    pieces = [
        replace(tiny.street(f"e{at}", (60 * at, 0), (60 * at + 60, 0)), id=f"s{at}", street=name)
        for at, name in enumerate(names)
    ]
    return tiny.world(pieces)


def test_missions_inspect_named_streets_and_segments_alone() -> None:
    town = avenue("Bell Lane", "Mill Road", "High Street", "Bell Lane")
    usual = {"altitudes_m": [10], "policies": ["baseline"], "densities": ["low"], "replicates": 40}
    made = plan(design(streets=["bell lane", "s2"], **usual), [town])
    assert {town.segments[at].id for unit in made.units for at in made.segments(unit)} == {"s0", "s2", "s3"}
    assert plan(design(**usual), [town]).targets == ((0, 1, 2, 3),)


def test_worlds_of_one_name_are_refused_with_it() -> None:
    towns = [replace(avenue("Bell Lane"), name=name) for name in ("first", "both", "both")]
    with pytest.raises(PaveTwinError, match=r"two of its worlds are called 'both', .* rename the folder of one"):
        plan(design(worlds=["a", "b", "c"]), towns)


def test_a_street_need_not_be_in_every_world() -> None:
    first, other = (replace(avenue(name), name=name) for name in ("Bell Lane", "Mill Road"))
    made = design(worlds=["a", "b"], streets=["Bell Lane", "Mill Road"], altitudes_m=[10], policies=["baseline"])
    assert plan(made, [first, other]).targets == ((0,), (0,))
    with pytest.raises(PaveTwinError, match="segments: the design requests 1, but 'Mill Road' has only 0 of Bell Lane"):
        plan(made.model_copy(update={"streets": ("Bell Lane",)}), [first, other])


def test_replicates_inspect_segments_independently() -> None:
    """Over many replicates each segment is drawn about as often as any other, and neighbours are not linked."""
    made = plan_of(design(replicates=600, densities=["low"]))
    drawn = [made.segments(unit)[0] for unit in made.units]
    assert all(60 < drawn.count(segment) < 140 for segment in range(6))
    assert 60 < sum(first == second for first, second in pairwise(drawn)) < 140


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"densities": []}, "densities: give at least one"),
        ({"policies": []}, "policies"),
        ({"replicates": 0}, "replicates"),
        ({"altitudes_m": [6, 6]}, "given twice"),
        ({"altitudes_m": [6, 2]}, "altitudes_m.2: the UAV flies at 5 m or higher"),
        ({"altitudes_m": [6, 3000]}, "altitudes_m.2: the UAV flies at 120 m or lower"),
        ({"polices": ["hover"]}, r"unknown key 'polices' \(did you mean 'policies'\?\)"),
        ({"sweep": {"tau_o": []}}, "sweep.tau_o"),
        ({"sweep": {"tau_o": [0.5, 0.5]}}, "given twice"),
        ({"sweep": {"tauo": [0.5, 0.7]}}, r"sweep: unknown setting 'tauo' \(did you mean 'tau_o'\?\)"),
        ({"sweep": {"zzz": [1, 2]}}, "short names are tau_o, "),
        ({"sweep": {"altitude_m": [6]}}, "list its values under 'altitudes_m'"),
        ({"sweep": {"tau_o": [0.5]}, "set": {"visibility.threshold": 0.6}}, "given twice, under sweep or set"),
        ({"worlds": ["a", "a"]}, "one of them is given twice"),
        ({"set": {"altitude_m": 12}}, "altitude_m is a factor; list its values under 'altitudes_m'"),
        ({"sweep": {"sensing.sensor": ["ideal"]}}, "list its values under 'sensors'"),
        ({"worlds": [{"path": "a", "routes": ["r"]}], "densities": ["low"]}, "every world has its own traffic"),
        ({"worlds": [{"path": "a", "routes": ["r"], "recordings": ["b"]}]}, "routes or recordings, not both"),
        ({"worlds": [{"path": "a", "recordings": ["b/x.parquet", "c/x.parquet"]}]}, "two of them are called 'x'"),
        ({"worlds": [{"path": "a", "take_off_s": [0, 60]}]}, "take_off_s: only with routes or recordings"),
        ({"worlds": [{"path": "a", "routes": ["r"], "take_off_s": [60, 0]}]}, "the earliest comes first"),
        ({"defects": {"per_segmnt": 3}}, "per_segmnt"),
        ({"sensors": "ideal"}, r"sensors: give a list, like \[ideal\]"),
        ({"sweep": {"tau_o": 0.5}}, r"sweep: tau_o: give a list, like \[0.5\]"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(values: dict[str, object], words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        design(**values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"densities": ["dense"]}, "dense"),
        (
            {"densities": ["low", 600]},
            "^the design: densities: no density '600'.* v12-p40 is 12 vehicles per kilometre of lane",
        ),
        ({"densities": ["v200-p0"]}, "do not fit on a lane"),
        ({"worlds": [{"path": "town", "recordings": ["gone.parquet"]}]}, "no recording 'gone.parquet'"),
        ({"policies": ["hoover"]}, r"did you mean 'hover'\?"),
        ({"sensors": ["eye"]}, "eye"),
        (
            {"set": {"pattern.kind": "boustro"}},
            r"pattern.kind: no pattern 'boustro' \(did you mean 'boustrophedon'\?\)",
        ),
        ({"sweep": {"pattern.kind": ["out_and_back", "spiral"]}}, "no pattern 'spiral'"),
        ({"presets": ["papre"]}, r"did you mean 'paper'\?"),
        ({"sweep": {"policy.wait": [1]}}, r"unknown key 'wait'"),
        ({"sweep": {"tau_o": [0.5, 1.5]}}, "visibility.threshold"),
        ({"set": {"altitude_m.x": 3}}, "'altitude_m.x' is not a setting"),
        ({"worlds": [{"path": "town", "routes": ["gone.rou.xml"]}]}, "no routes file 'gone.rou.xml'"),
        (
            {"streets": ["stret"]},
            r"^the design: streets: No segment or street 'stret' in the world 'tiny' \(did you mean 'street'\?\)",
        ),
        ({"segments": 3}, "segments: the design requests 3, but 'tiny' has only 1"),
    ],
)
def test_levels_that_do_not_exist_are_refused_before_anything_is_flown(values: dict[str, object], words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        plan(design(**values), [tiny.straight()])


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("mine.py:Bad", r"'.*mine\.py:Bad' breaks a rule: "),
        ("mine.py", r"'mine\.py' names no class"),
    ],
)
def test_a_policy_that_cannot_fly_refuses_the_design(tmp_path: Path, policy: str, words: str) -> None:
    """In the words of a design: `experiment run` has no option `--policy`."""
    own = [
        "from pavetwin.policies import Policy",
        "class Bad(Policy):",
        "    def decide(self, situation):",
        "        return 3",
    ]
    (tmp_path / "mine.py").write_text("\n".join(own), encoding="utf-8")
    (tmp_path / "d.yaml").write_text(f"worlds: [town]\npolicies: [baseline, '{policy}']\n", encoding="utf-8")
    with pytest.raises(PaveTwinError, match=f"^the design: policies: {words}"):
        plan(read_design(tmp_path / "d.yaml"), [tiny.straight()])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ("plugins: [gone.py]", r"^the design: plugins: there is no file '.*gone\.py'"),
        ("policies: [hoover]", r"^the design: policies: no policy 'hoover'.* needs its file in plugins\.$"),
        ("sensors: [idael]", r"^the design: sensors: no sensor 'idael' \(did you mean 'ideal'\?\)"),
    ],
)
def test_what_is_wrong_in_a_design_goes_by_its_key(tmp_path: Path, values: str, words: str) -> None:
    (tmp_path / "d.yaml").write_text(f"worlds: [town]\n{values}\n", encoding="utf-8")
    with pytest.raises(PaveTwinError, match=words):
        plan(read_design(tmp_path / "d.yaml"), [tiny.straight()])


def test_paths_are_relative_to_the_design_s_file(tmp_path: Path) -> None:
    (tmp_path / "d.yaml").write_text("worlds: [towns/a]\npolicies: [baseline, mine.py:Careful]\n", encoding="utf-8")
    made = read_design(tmp_path / "d.yaml")
    assert made.worlds[0].path == str(tmp_path / "towns" / "a")
    assert made.policies == ("baseline", f"{tmp_path / 'mine.py'}:Careful")
    assert placed_at(made, Path("/elsewhere")) == made


CAMERAS = """
a: {title: A, image_px: [640, 480], vertical_fov_deg: 60}
b: {title: B, image_px: [640, 480], vertical_fov_deg: 30}
"""


@pytest.mark.parametrize(
    ("values", "titles"),
    [
        ("set: {camera.model: 'cameras.yaml:b'}", ["B"]),
        ("sweep: {camera.model: [paper, 'cameras.yaml:a', cameras.yaml:b]}", ["Virtual camera", "A", "B"]),
    ],
)
def test_a_camera_file_is_relative_to_the_design_s_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, values: str, titles: list[str]
) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "cameras.yaml").write_text(CAMERAS, encoding="utf-8")
    (tmp_path / "studies" / "d.yaml").write_text(f"worlds: [town]\naltitudes_m: [10]\n{values}\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    made = plan(read_design(Path("studies/d.yaml")), [tiny.straight()])
    found = dict.fromkeys(find_camera(cell.settings(made.design).camera.model).title for cell in made.cells)
    assert [title.partition(" of ")[0] for title in found] == titles
    assert str(tmp_path / "studies" / "cameras.yaml") in made.files


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("worlds: [a]\nseed: 1\nreplicates: 3\nseed: 2\n", "line 4: 'seed' is given twice, first in line 2"),
        ("worlds: [a]\nsweep:\n  tau_o: [0.5]\n  'tau_o': [0.7]\n", "line 4: 'tau_o' is given twice, first in line 3"),
        ("worlds: [{path: a, path: b}]\n", "line 1: 'path' is given twice"),
    ],
)
def test_a_key_given_twice_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "d.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(PaveTwinError, match=rf"^the design '.*d\.yaml', {words}\.?"):
        read_design(tmp_path / "d.yaml")


def test_a_value_that_is_merged_may_be_given_again(tmp_path: Path) -> None:
    text = "worlds:\n  - &one {path: a, routes: [r.rou.xml]}\n  - &two {<<: *one, path: b}\n  - {<<: *two, path: c}\n"
    (tmp_path / "d.yaml").write_text(text, encoding="utf-8")
    made = read_design(tmp_path / "d.yaml")
    assert [Path(world.path).name for world in made.worlds] == ["a", "b", "c"]
    assert len({world.routes for world in made.worlds}) == 1


@pytest.mark.parametrize(
    ("text", "words"), [("a: [", "is not valid YAML"), ("- 1", "holds no keys"), ("", "holds no keys")]
)
def test_a_file_that_is_no_design_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "d.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(PaveTwinError, match=words):
        read_design(tmp_path / "d.yaml")
    with pytest.raises(PaveTwinError, match="experiment init"):
        read_design(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({"seed": 9}, id="a seed"),
        pytest.param({"defects": {"per_100_m2": 4}}, id="defects by area"),
        pytest.param({"defects": {"per_segment": 4}}, id="defects by segment"),
        pytest.param({"worlds": [{"path": "a", "routes": ["a.rou.xml"]}]}, id="no word on densities"),
    ],
)
def test_the_design_of_a_study_s_folder_is_a_design(tmp_path: Path, values: dict[str, object]) -> None:
    made = design(**values)
    written = {"format": 1, "pavetwin": "0", "design": made.model_dump(mode="json")}
    (tmp_path / "design.yaml").write_text(yaml.safe_dump(written), encoding="utf-8")
    read = read_design(tmp_path / "design.yaml")
    assert units_of(read) == units_of(made)
    assert read.model_dump() == placed_at(made, tmp_path).model_dump()


def test_a_study_over_a_world_s_own_defects_notices_that_they_changed(tmp_path: Path) -> None:
    made = design(worlds=[str(tmp_path / "cross")], altitudes_m=[10], densities=["low"], defects="world")
    placed = made.model_copy(update={"defects": "placed"})
    save_world(damaged("cross", 2), tmp_path / "cross")
    before = {each.defects: plan(each, load_worlds(each)).hashes[0] for each in (made, placed)}
    save_world(damaged("cross", 3), tmp_path / "cross", force=True)
    after = {each.defects: plan(each, load_worlds(each)).hashes[0] for each in (made, placed)}
    assert after["placed"] == before["placed"]
    assert after["world"] != before["world"]
    assert world_of_study(made.worlds[0].path, after["world"]).name == "cross"
    with pytest.raises(PaveTwinError, match="is not the one that the study began with"):
        world_of_study(made.worlds[0].path, before["world"])


def test_a_study_notices_that_a_population_of_the_package_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_world(damaged("cross", 2), tmp_path / "cross")
    made = design(worlds=[str(tmp_path / "cross")], altitudes_m=[10], densities=["low"], defects={"per_segment": 1})
    store, begun = Store(tmp_path / "study"), plan(made, load_worlds(made))
    store.begin(begun)
    store.check(begun)
    survey = populations.population("survey")
    denser = survey.model_copy(update={"density": survey.density.model_copy(update={"segment_sigma": 2.0})})
    monkeypatch.setattr(populations, "population", lambda name: denser if name == "survey" else survey)
    with pytest.raises(PaveTwinError, match=r"begun with the damage population 'survey' of other content than it has"):
        store.check(plan(made, load_worlds(made)))


def test_a_study_goes_on_with_the_models_that_it_was_begun_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_world(damaged("cross", 2), tmp_path / "cross")
    sensors = ["recall", "detector", "calibrated"]
    made = design(worlds=[str(tmp_path / "cross")], altitudes_m=[10], densities=["low"], sensors=sensors)
    store, begun = Store(tmp_path / "study"), plan(made, load_worlds(made))
    store.check_models(begun)
    store.begin(begun)
    named = {"detector": {"model": DEFAULT}, "calibrated": {"fitted": DEFAULT}}
    assert store.models() == yaml.safe_load((store.folder / "design.yaml").read_text())["models"] == named
    store.check_models(begun)
    monkeypatch.setattr(DetectorSensor, "default_options", {**DetectorSensor.default_options, "model": "photographs"})
    later = plan(made, load_worlds(made))
    with pytest.raises(PaveTwinError, match=rf"begun with the model {DEFAULT} of the sensor 'detector' \(now photog"):
        store.check_models(later)
    store.begin(later)
    assert store.models() == named, "what was flown stays what it was"
    chosen = plan(made.model_copy(update={"set": {"sensing.options.model": DEFAULT}}), load_worlds(made))
    assert chosen.models == {"calibrated": {"fitted": DEFAULT}}

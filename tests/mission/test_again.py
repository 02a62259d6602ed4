"""A mission's description: read from anywhere, after a move, in its former format, and compared with what comes out."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError
from pavetwin.mission import fly, load_inputs, plan_mission, save_mission
from pavetwin.mission.again import FormerMission, check_replaceable, read_mission
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.inputs import world_of
from pavetwin.mission.spec import DefectInput, TrafficInput
from pavetwin.perception.shipped import DEFAULT
from pavetwin.traffic.demand import density_named
from pavetwin.world.store import load_world, save_world
from scenes import built, damaged

POLICY = """
from pathlib import Path
from typing import Any
from pavetwin.policies import GoOn, Policy
DATA_FILES = ["seconds.txt"]
class Patient(Policy):
    def decide(self, snapshot):
        float(Path(__file__).with_name("seconds.txt").read_text())
        return GoOn()
"""


def place(folder: Path) -> Path:
    """A folder with a world, a policy of the user's own with its data, and a mission of them. Its mission.yaml."""
    save_world(damaged("cross", 8), folder / "town")
    (folder / "patient.py").write_text(POLICY)
    (folder / "seconds.txt").write_text("2.0")
    world = load_world(folder / "town")
    spec = plan_mission(
        world, load_settings(), density="low", segments=1, policy=f"{folder / 'patient.py'}:Patient", seed=1
    )
    save_mission(fly(spec), folder / "results" / "m")
    return folder / "results" / "m" / "mission.yaml"


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return place(tmp_path_factory.mktemp("again"))


def flown_again(former: FormerMission) -> MissionResult:
    world = world_of(former.spec.world)
    spec = former.planned(world)
    return fly(spec, inputs=load_inputs(spec, world=world))


def changed(described: Path, folder: Path, **values: object) -> Path:
    """The description with other values, in a folder of its own."""
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(described.read_text()) | values, sort_keys=False))
    return path


def test_a_world_named_from_another_folder_is_found(
    described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = described.parents[2]
    (home / "elsewhere").mkdir(exist_ok=True)
    monkeypatch.chdir(home / "elsewhere")
    spec = plan_mission(load_world(Path("../town")), density="low", segments=1)
    assert spec.world.path == str(home / "town")
    monkeypatch.chdir(tmp_path)
    assert world_of(spec.world).name == "town"


def test_results_moved_together_with_their_world_fly_again(described: Path, tmp_path: Path) -> None:
    home = described.parents[2]
    moved = tmp_path / "moved"
    shutil.copytree(home, moved)
    hidden = home.with_name("hidden")
    home.rename(hidden)
    try:
        former = read_mission(moved / "results" / "m" / "mission.yaml")
        assert former.spec.world.path == str(moved / "town")
        assert former.spec.policy.name == f"{moved / 'patient.py'}:Patient"
        assert {Path(file.path).name for file in former.spec.files()} == {"patient.py", "seconds.txt"}
        assert all(Path(file.path).parent == moved for file in former.spec.files())
        assert former.folder_again == moved / "results" / "m-again"
        assert former.verdict(flown_again(former)) == "The same as the first time."
        (moved / "seconds.txt").write_text("3.0")
        with pytest.raises(PaveTwinError, match=f"'{home / 'seconds.txt'}' is gone"):
            read_mission(moved / "results" / "m" / "mission.yaml")
        other = tmp_path / "other"
        shutil.copytree(moved / "results", other / "results")
        save_world(built("cross", seed=2), other / "town")
        with pytest.raises(PaveTwinError, match=f"is not at '{home / 'town'}' any more"):
            world_of(read_mission(other / "results" / "m" / "mission.yaml", other_policy=True).spec.world)
    finally:
        hidden.rename(home)


DEFECTS = """id,segment,outcome,reason
0,{0},missed,too_small
1,{1},found,
2,{2},missed,hidden_by_parked_vehicles
3,elsewhere,missed,not_recognised
"""


def missing(described: Path, folder: Path, defects: str) -> FormerMission:
    """The mission over three segments, with other defects."""
    segments = [segment.id for segment in load_world(described.parents[2] / "town").segments[:3]]
    (folder / "defects.csv").write_text(defects.format(*segments))
    return read_mission(changed(described, folder, targets=[segments[2], segments[1], segments[0]]))


def test_only_segments_with_missed_defects_are_flown_again(described: Path, tmp_path: Path) -> None:
    former = missing(described, tmp_path, DEFECTS)
    world = load_world(described.parents[2] / "town")
    assert former.missed_segments() == (world.segments[0].id,), "what parked vehicles hide stays hidden"
    again = former.planned(world, targets=former.missed_segments())
    assert again.targets == (world.segments[0].id,)
    assert again.traffic == former.spec.traffic
    assert again.base == former.spec.base
    assert former.folder_of_missed == tmp_path.with_name(f"{tmp_path.name}-missed")
    all_missed = DEFECTS.replace("found,", "missed,outside_swath").replace("hidden_by_parked_vehicles", "too_small")
    former = missing(described, tmp_path, all_missed)
    assert former.missed_segments() == former.spec.targets, "in the order of the mission"


def test_a_mission_that_missed_nothing_is_not_flown_again(described: Path, tmp_path: Path) -> None:
    only_parked = "id,segment,outcome,reason\n0,{0},missed,hidden_by_parked_vehicles\n1,{0},found,\n"
    with pytest.raises(PaveTwinError, match=r"no defect that another flight could find; what it missed is under"):
        missing(described, tmp_path, only_parked).missed_segments()
    with pytest.raises(PaveTwinError, match=r"missed no defect that another flight could find\.$"):
        missing(described, tmp_path, "id,segment,outcome,reason\n").missed_segments()
    with pytest.raises(PaveTwinError, match=r"defects\.csv' cannot be read"):
        missing(described, tmp_path, "").missed_segments()


def test_data_that_a_policy_declares_is_an_input(described: Path) -> None:
    data = described.parents[2] / "seconds.txt"
    assert str(data) in {file.path for file in read_mission(described).spec.files()}
    data.write_text("9.0")
    try:
        with pytest.raises(PaveTwinError, match=f"inputs are not what they were: '{data}' has changed"):
            read_mission(described)
        assert read_mission(described, other_policy=True).spec.seed == 1
    finally:
        data.write_text("2.0")


def of_old(described: Path, model: str) -> dict[str, Any]:
    """The settings as they were before there were aircraft."""
    settings: dict[str, Any] = yaml.safe_load(described.read_text())["settings"]
    del settings["aircraft"]
    settings["camera"]["model"] = "paper"
    settings["energy"] = {"model": model, "capacity_wh": 81.3, "hover_endurance_s": 1680.0, "mass_kg": 1.38}
    return settings


@pytest.mark.parametrize("old", [3, 4])
def test_missions_from_before_aircraft_are_read_when_their_battery_was_linear(
    old: int, described: Path, tmp_path: Path
) -> None:
    versions = {"pavetwin": yaml.safe_load(described.read_text())["versions"]["pavetwin"]}
    linear = of_old(described, "linear")
    spec = read_mission(changed(described, tmp_path, format=old, versions=versions, settings=linear)).spec
    assert (spec.format, spec.settings.aircraft, spec.settings.energy.model) == (5, None, "linear")
    with pytest.raises(PaveTwinError, match=r"reads format 5, and 3 and 4 with `energy.model=linear`"):
        read_mission(changed(described, tmp_path, format=old, settings=of_old(described, "rotor")))
    with pytest.raises(PaveTwinError, match="format 3 or 4 or 5"):
        read_mission(changed(described, tmp_path, format=2))


def test_a_mission_of_format_3_takes_off_in_the_street(described: Path, tmp_path: Path) -> None:
    settings = of_old(described, "linear")
    del settings["uav"]["base"]
    former = read_mission(changed(described, tmp_path, format=3, settings=settings))
    assert former.spec.settings.uav.base == "street"


def test_a_spec_with_the_area_that_it_once_held_is_the_same_mission(described: Path, tmp_path: Path) -> None:
    traffic = yaml.safe_load(described.read_text())["traffic"]
    assert "area" not in traffic
    path = changed(described, tmp_path, traffic=traffic | {"area": "all"})
    spec = read_mission(path).spec
    assert spec == read_mission(described).spec
    check_replaceable(tmp_path, [spec])


def test_a_mission_in_the_nearest_traffic_may_be_replaced_by_one_that_allows_it(
    described: Path, tmp_path: Path
) -> None:
    spec = read_mission(described).spec
    allowing = TrafficInput.of(density_named("los-C"), seed=1, or_nearest=True)
    flown = allowing.model_copy(update={"density": "los-D", "instead_of": "los-C", "or_nearest": False})
    changed(described, tmp_path, traffic=flown.model_dump(mode="json"))
    check_replaceable(tmp_path, [spec.model_copy(update={"traffic": allowing})])
    for other in ({"seed": 2}, {"or_nearest": False}):
        traffic = allowing.model_copy(update=other)
        with pytest.raises(PaveTwinError, match=r"holds another mission \(other traffic\)"):
            check_replaceable(tmp_path, [spec.model_copy(update={"traffic": traffic})])


def test_each_version_that_differs_is_named(described: Path, tmp_path: Path) -> None:
    versions = yaml.safe_load(described.read_text())["versions"]
    assert {"pavetwin", "libsumo", "python", "numpy"} <= set(versions)
    assert "wgpu" not in versions, "no image was taken"
    former = read_mission(changed(described, tmp_path, versions=versions | {"numpy": "1.0", "wgpu": "0.1"}))
    numpy, wgpu = former.version_changes()
    assert numpy == f"numpy 1.0 (now {versions['numpy']})"
    assert wgpu.startswith("wgpu 0.1 (now ")


def test_another_seed_of_the_defects_is_another_mission(described: Path) -> None:
    former = read_mission(described)
    world = world_of(former.spec.world)
    spec = former.planned(world, defect_seed=5)
    assert spec.defects.options == DefectOptions(population="paper", per_segment=8), "as those of the world"
    result = fly(spec, inputs=load_inputs(spec, world=world))
    assert former.verdict(result).startswith("Not the same mission as before")


def test_defects_placed_before_there_were_populations_are_the_papers(described: Path, tmp_path: Path) -> None:
    hash_of = yaml.safe_load(described.read_text())["defects"]["content_hash"]
    for options, found in (({"per_segment": 3}, {"per_segment": 3}), (None, {}), ({"population": "survey"}, {})):
        defects = {"seed": 5, "options": options, "on": "world", "content_hash": hash_of}
        former = read_mission(changed(described, tmp_path, defects=defects))
        of = (options or {}).get("population", "paper")
        assert former.spec.defects.options == DefectOptions(population=of, **found)
    assert read_mission(described).spec.defects.options is None, "the world's own"
    assert DefectInput(seed=5).options == DefectOptions()


def test_a_mission_of_before_models_were_named_says_so(described: Path, tmp_path: Path) -> None:
    """Which fitted sensor it had cannot be known; what is flown again names that of now, and is not another mission."""
    former = read_mission(described)
    assert former.unnamed_models() is None
    settings = yaml.safe_load(described.read_text())["settings"]
    path = changed(described, tmp_path, settings={**settings, "sensing": {"sensor": "calibrated"}})
    old = read_mission(path)
    assert old.unnamed_models() == (
        f"'{path}' does not say which model its sensor 'calibrated' had; now it is {DEFAULT}."
    )
    spec = old.planned(load_world(described.parents[2] / "town"))
    assert spec.settings.sensing.options == {"fitted": DEFAULT}
    result = replace(flown_again(former), spec=spec)
    assert old.verdict(result) == "The same as the first time."

"""A mission's description: read from anywhere, after a move, and compared with what comes out."""

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError
from pavetwin.mission import fly, load_inputs, plan_mission, save_mission
from pavetwin.mission.folder import MissionFolder, check_replaceable
from pavetwin.mission.inputs import world_of
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import TrafficInput
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


def flown_again(former: MissionFolder) -> MissionResult:
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
        former = MissionFolder(moved / "results" / "m" / "mission.yaml")
        assert former.spec.world.path == str(moved / "town")
        assert former.spec.policy.name == f"{moved / 'patient.py'}:Patient"
        assert {Path(file.path).name for file in former.spec.files()} == {"patient.py", "seconds.txt"}
        assert all(Path(file.path).parent == moved for file in former.spec.files())
        assert former.folder_again == moved / "results" / "m-again"
        assert former.verdict(flown_again(former)) == "The same as the first time."
        (moved / "seconds.txt").write_text("3.0")
        with pytest.raises(PaveTwinError, match=f"'{home / 'seconds.txt'}' is gone"):
            _ = MissionFolder(moved / "results" / "m").spec
        other = tmp_path / "other"
        shutil.copytree(moved / "results", other / "results")
        save_world(built("cross", seed=2), other / "town")
        with pytest.raises(PaveTwinError, match=f"is no longer at '{home / 'town'}'"):
            world_of(MissionFolder(other / "results" / "m" / "mission.yaml", other_policy=True).spec.world)
    finally:
        hidden.rename(home)


DEFECTS = """id,segment,outcome,reason
0,{0},missed,too_small
1,{1},found,
2,{2},missed,hidden_by_parked_vehicles
3,elsewhere,missed,not_recognised
"""


def missing(described: Path, folder: Path, defects: str) -> MissionFolder:
    """The mission over three segments, with other defects."""
    segments = [segment.id for segment in load_world(described.parents[2] / "town").segments[:3]]
    (folder / "defects.csv").write_text(defects.format(*segments))
    return MissionFolder(changed(described, folder, targets=[segments[2], segments[1], segments[0]]))


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
    assert str(data) in {file.path for file in MissionFolder(described).spec.files()}
    data.write_text("9.0")
    try:
        with pytest.raises(PaveTwinError, match=f"inputs have changed: '{data}' has changed"):
            _ = MissionFolder(described).spec
        assert MissionFolder(described, other_policy=True).spec.seed == 1
    finally:
        data.write_text("2.0")


@pytest.mark.parametrize("values", [{"format": 2}, {"format": None}, {"totals": None}])
def test_a_description_of_another_format_or_without_totals_is_refused(
    described: Path, tmp_path: Path, values: dict[str, Any]
) -> None:
    with pytest.raises(PaveTwinError, match=r"mission\.yaml'"):
        MissionFolder(changed(described, tmp_path, **values))


def test_a_mission_in_the_nearest_traffic_may_be_replaced_by_one_that_allows_it(
    described: Path, tmp_path: Path
) -> None:
    spec = MissionFolder(described).spec
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
    former = MissionFolder(changed(described, tmp_path, versions=versions | {"numpy": "1.0", "wgpu": "0.1"}))
    numpy, wgpu = former.version_changes()
    assert numpy == f"numpy 1.0 (now {versions['numpy']})"
    assert wgpu.startswith("wgpu 0.1 (now ")


def test_another_seed_of_the_defects_is_another_mission(described: Path) -> None:
    former = MissionFolder(described)
    world = world_of(former.spec.world)
    spec = former.planned(world, defect_seed=5)
    assert spec.defects.options == DefectOptions(population="paper", per_segment=8), "as those of the world"
    result = fly(spec, inputs=load_inputs(spec, world=world))
    assert former.verdict(result).startswith("Not the same mission as before")

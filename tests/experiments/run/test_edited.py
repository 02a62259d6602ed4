"""Studies after an edit: what it concerns is flown again, and nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest
from polars.testing import assert_frame_equal

from pavetwin.experiments import fly_unit
from pavetwin.experiments.engine import Single
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store, query
from pavetwin.mission.fly import fly
from pavetwin.navigation.patterns import PATTERNS
from pavetwin.policies import POLICIES
from pavetwin.world.store import load_world
from scenes.folders import digests
from scenes.studies import small

MINE = """
from pavetwin.policies import GoOn, Policy

class Mine(Policy):
    name = "mine"  # {}

    def decide(self, snapshot):
        return GoOn()
"""


@pytest.fixture
def flights(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The policy of each mission as it is flown, the path of its file left out."""
    found: list[str] = []

    def noted(spec, **how):
        found.append(spec.policy.name.rpartition(":")[2])
        return fly(spec, **how)

    monkeypatch.setattr(fly_unit, "fly", noted)
    return found


@pytest.mark.slow
def test_only_the_missions_of_an_edited_policy_are_flown_again(world: Path, tmp_path: Path, flights: list[str]) -> None:
    file, folder, notices = tmp_path / "mine.py", tmp_path / "study", []
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=2)
    run(design, folder, Single(), on_notice=notices.append)
    before = Store(folder).table()
    file.write_text(MINE.format("second"))
    flights.clear()
    assert notices == []
    ran = run(design, folder, Single(), on_notice=notices.append)
    assert (ran.missions_flown, set(flights)) == (8, {"Mine"})
    assert notices == [
        f"mine.py changed since: 8 of 16 missions are flown again; their former rows are kept in {folder / 'former'}."
    ]
    run(design, tmp_path / "from the second on", Single())
    former = [path for path in digests(folder) if path.startswith("former/")]
    assert {path: it for path, it in digests(folder).items() if path not in former} == digests(
        tmp_path / "from the second on"
    )
    old = before.filter(policy="mine")
    assert {Path(path).parts[1] for path in former} == set(old["files_hash"])
    assert_frame_equal(Store(folder).former(), old, check_row_order=False)
    assert set(old["files_hash"]).isdisjoint(ran.table.filter(policy="mine")["files_hash"])
    assert ran.table.filter(policy="baseline")["files_hash"].is_null().all()
    count = "select count(*) n from former where policy = 'mine'"
    assert query(folder, count)["n"].to_list() == [8]
    assert run(design, folder, Single()).missions_flown == 0


def test_a_study_that_is_stopped_after_an_edit_holds_no_mission_of_before(
    world: Path, tmp_path: Path, flights: list[str]
) -> None:
    file, folder = tmp_path / "mine.py", tmp_path / "study"
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], densities=["low"])
    run(design, folder, Single())
    file.write_text(MINE.format("second"))

    class Stopped(Single):
        def fly(self, plan, units, listener):
            super().fly(plan, units[:1], listener)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(design, folder, Stopped())
    left = Store(folder).table()
    assert (left.filter(policy="baseline").height, left.filter(policy="mine").height) == (6, 2)
    assert left.filter(policy="mine")["files_hash"].n_unique() == 1
    assert Store(folder).former().height == 6
    flights.clear()
    run(design, folder, Single())
    assert flights == ["Mine"] * 4
    run(design, tmp_path / "never stopped", Single())
    assert_frame_equal(Store(folder).table(), Store(tmp_path / "never stopped").table())


def test_what_a_policy_imports_is_part_of_it(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flights: list[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    file, helper = tmp_path / "mine.py", tmp_path / "helper_of_mine.py"
    file.write_text("import helper_of_mine\n" + MINE)
    helper.write_text("LIMIT = 1")
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=1, densities=["low"])
    run(design, tmp_path / "study", Single())
    assert set(Store(tmp_path / "study").description()["files"]) == {str(file), str(helper)}
    assert run(design, tmp_path / "study", Single()).missions_flown == 0
    helper.write_text("LIMIT = 2")
    flights.clear()
    run(design, tmp_path / "study", Single())
    assert flights == ["Mine"] * 2


@pytest.mark.parametrize(
    ("more", "again"),
    [
        pytest.param("", ["careful"], id="a policy alone"),
        pytest.param(
            "from pavetwin.navigation.patterns import PATTERNS\nPATTERNS.add('odd', PATTERNS.get('boustrophedon'))",
            ["baseline", "careful"],
            id="a pattern too",
        ),
    ],
)
def test_an_edited_plugin_concerns_what_it_registers(
    world: Path, tmp_path: Path, flights: list[str], more: str, again: list[str]
) -> None:
    file, folder = tmp_path / "plugin.py", tmp_path / "study"
    own = MINE.replace("class Mine", "@policy('careful')\nclass Careful").replace("Policy\n", "Policy, policy\n", 1)
    file.write_text(f"{own.replace('mine', 'careful')}\n{more}")
    design = small(
        world, policies=["baseline", "careful"], plugins=[str(file)], replicates=1, densities=["low"], altitudes_m=[10]
    )
    try:
        run(design, folder, Single())
        file.write_text(file.read_text() + "\n# thought over")
        flights.clear()
        run(design, folder, Single())
        assert flights == again
    finally:
        POLICIES.restore("careful", None)
        if more:
            PATTERNS.restore("odd", None)


def test_a_file_that_is_edited_while_a_study_flies_fails_its_missions(world: Path, tmp_path: Path) -> None:
    """They would stand in the table under another file than they were flown with."""
    file, folder = tmp_path / "mine.py", tmp_path / "study"
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=2, densities=["low"], altitudes_m=[10])

    class Edited(Single):
        def fly(self, plan, units, listener):
            super().fly(plan, units[:1], listener)
            file.write_text(MINE.format("second"))
            super().fly(plan, units[1:], replace(listener, on_ready=lambda: None))

    ran = run(design, folder, Edited())
    assert list(ran.failures) == [f"the design: '{file}' is not what the study began with."]
    assert run(design, folder, Single(), retry=True).missions_flown == 3
    assert not run(design, folder, Single()).failures


def test_missions_over_changed_routes_are_flown_again(world: Path, tmp_path: Path) -> None:
    edge = next(lane.edge for lane in load_world(world).lanes if lane.kind == "driving")
    route, folder = tmp_path / "own.rou.xml", tmp_path / "study"

    def departing(*times_s: int) -> str:
        trips = (f'<trip id="t{time_s}" depart="{time_s}" from="{edge}" to="{edge}"/>' for time_s in times_s)
        return f"<routes>{''.join(trips)}</routes>"

    entry = {"path": str(world), "routes": [str(route)], "take_off_s": [500, 500]}
    design = small(world, worlds=[entry], densities=[], replicates=1, altitudes_m=[10])
    route.write_text(departing(0))
    assert sum(run(design, folder, Single()).failures.values()) == 2
    route.write_text(departing(0, *range(400, 900, 20)))
    ran = run(design, folder, Single())
    assert (ran.missions_flown, ran.failures) == (2, {})
    assert (Store(folder).former()["status"] == "failed").all()

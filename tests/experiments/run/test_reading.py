"""Studies that were flown: their table, damaged parts, and engines that are not there."""

import shutil
import socket
import threading
from pathlib import Path

import pytest
from distributed import LocalCluster

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Cluster, Single, in_batches
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store, query
from pavetwin.experiments.units import units_of
from pavetwin.world.store import load_world
from scenes.studies import small


def test_sql_over_the_table(reference: Path) -> None:
    answer = query(reference, "select policy, count(*) n, avg(time_s) t from segments group by policy order by policy")
    table = Store(reference).table()
    assert answer["n"].to_list() == [12, 12]
    assert answer["t"].to_list() == pytest.approx(
        [table.filter(policy=name)["time_s"].mean() for name in ("baseline", "hover")]
    )


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("select foo from segments", "The query failed.*foo"),
        ("drop view segments", "not a query"),
        ("???", "query"),
        ("copy segments to 'x.csv'", "not a query"),
        ("from read_csv('/etc/passwd')", "The query failed"),
    ],
)
def test_an_invalid_query_is_refused(reference: Path, sql: str, words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        query(reference, sql)


def test_a_folder_without_a_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="holds no study"):
        query(tmp_path, "from segments")


def test_a_damaged_part_is_flown_again(world: Path, tmp_path: Path) -> None:
    design = small(world, replicates=1, densities=["low"])
    run(design, tmp_path / "study", Single())
    (part,) = (tmp_path / "study" / "segments.parquet").iterdir()
    whole = part.read_bytes()
    for broken in (whole[: len(whole) // 2], whole[:40] + bytes(2000) + whole[2040:]):
        part.write_bytes(broken)
        with pytest.raises(PaveTwinError, match="is damaged; run the study again"):
            Store(tmp_path / "study").table()
        assert run(design, tmp_path / "study", Single()).missions_flown == 4
        assert part.read_bytes() == whole


def test_a_part_in_another_s_place_is_not_counted_twice(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "study")
    parts = Store(tmp_path / "study").parts()
    shutil.copyfile(parts[0], parts[2])
    with pytest.raises(PaveTwinError, match="holds another part of a study"):
        Store(tmp_path / "study").table()


def test_a_damaged_design_is_refused(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "study")
    (tmp_path / "study" / "design.yaml").write_text("design: 3")
    with pytest.raises(PaveTwinError, match=r"design\.yaml"):
        Store(tmp_path / "study").table()


def test_taking_off_after_one_s_own_demand_has_ended_is_a_failure(world: Path, tmp_path: Path) -> None:
    edges = [lane.edge for lane in load_world(world).lanes if lane.kind == "driving"]
    route = tmp_path / "short.rou.xml"
    route.write_text(f'<routes><trip id="a" depart="0" from="{edges[0]}" to="{edges[0]}"/></routes>')
    entry = {"path": str(world), "routes": [str(route)], "take_off_s": [500, 600]}
    ran = run(small(world, worlds=[entry], densities=[], replicates=1), tmp_path / "study", Single())
    assert len(ran.failures) == 1
    assert "its demand has ended; change take_off_s" in next(iter(ran.failures))


def test_a_missing_scheduler_is_refused(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.experiments.engine.ANSWER_S", 1.0)
    with pytest.raises(PaveTwinError, match=r"`scheduler` tcp://127.0.0.1:9: no Dask scheduler answers there"):
        run(small(world), tmp_path / "study", Cluster(scheduler="tcp://127.0.0.1:9"))
    assert list(tmp_path.iterdir()) == [], "another design may be flown there"


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" * 9], ids=["nothing", "of the web"])
def test_a_server_that_is_no_scheduler_is_refused(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes
) -> None:
    monkeypatch.setattr("pavetwin.experiments.engine.ANSWER_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def serve() -> None:
            caller, _ = server.accept()
            caller.sendall(answer)
            with caller:
                while caller.recv(4096):
                    pass

        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(PaveTwinError, match=f"`scheduler` {address}: no Dask scheduler answers there"):
            run(small(world), tmp_path / "study", Cluster(scheduler=address))
    assert list(tmp_path.iterdir()) == []


def test_a_scheduler_without_workers_is_refused(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    with LocalCluster(n_workers=0, processes=False, protocol="tcp://", dashboard_address=None) as cluster:
        monkeypatch.setattr("pavetwin.experiments.engine.ANSWER_S", 1.0)
        engine = Cluster(scheduler=cluster.scheduler_address)
        with pytest.raises(PaveTwinError, match="has no workers"):
            run(small(world), tmp_path / "study", engine, on_progress=lambda _share, what: reported.append(what))
    assert reported[-1] == f"Waiting for workers of the Dask scheduler {cluster.scheduler_address}"


def test_a_replicate_stays_with_one_process_while_there_are_enough_of_them() -> None:
    design = Design.parse({"worlds": ["a"], "replicates": 6}, where="the design")
    units = units_of(design)
    assert [len(batch) for batch in in_batches(units, 3)] == [3] * 6
    assert [len(batch) for batch in in_batches(units, 4)] == [1] * 18
    assert [unit for batch in in_batches(units, 3) for unit in batch] == list(units)


def test_a_study_of_another_format_is_refused(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "other")
    description = tmp_path / "other" / "design.yaml"
    description.write_text(description.read_text().replace("format: 1", "format: 2"))
    with pytest.raises(PaveTwinError, match=r"has format 2; this version reads only format 1"):
        Store(tmp_path / "other").table()

"""Tasks of the page: colours, shared folders and the process that runs them."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import PIPE
from types import SimpleNamespace
from typing import Any

import pytest

from pavetwin.app.colours import FILE, page_colours
from pavetwin.app.exports import exports, make_export
from pavetwin.app.flights import _file_names, listed_missions
from pavetwin.app.session_cache import alone_in, made_once
from pavetwin.app.task_process import _Progress, _reply
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import PLAN_FORMATS
from scenes.folders import digests
from scenes.page import RunningPage


def test_the_colours_are_those_of_maps_and_reports() -> None:
    assert json.loads(FILE.read_text(encoding="utf-8")) == page_colours(), "run `python -m pavetwin.app.colours`"


def test_the_tasks_of_the_page_draw_nothing() -> None:
    code = "import sys, pavetwin.app.tasks, pavetwin.app.street_map; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_what_another_task_has_made_meanwhile_stays(tmp_path: Path) -> None:
    target = tmp_path / "key"
    with made_once(target) as mine:
        (mine / "file").write_text("mine")
        with made_once(target) as other:
            assert other != mine, "each in a folder of its own"
            (other / "file").write_text("other")
        assert (target / "file").read_text() == "other"
    assert (target / "file").read_text() == "other"
    assert [path.name for path in tmp_path.iterdir()] == ["key"]


def test_what_is_broken_off_leaves_nothing(tmp_path: Path) -> None:
    def break_off() -> None:
        with made_once(tmp_path / "key") as made:
            (made / "file").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        break_off()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "key").write_text("a file")
    with pytest.raises(PaveTwinError, match="Not a directory"), made_once(tmp_path / "key"):
        pass


def test_one_task_at_a_time_works_in_a_folder_of_missions(tmp_path: Path) -> None:
    folder, session, reported = tmp_path / "missions" / "hover", tmp_path / "session", list[str]()
    is_in, order = threading.Event(), list[str]()

    def second() -> None:
        assert is_in.wait(20)
        with alone_in(folder, session, lambda _, what: reported.append(what)):
            order.append("second")

    with ThreadPoolExecutor(1) as other:
        waiting = other.submit(second)
        with alone_in(folder, session, lambda *_: None):
            is_in.set()
            deadline_s = time.monotonic() + 20
            while not reported and time.monotonic() < deadline_s:
                time.sleep(0.01)
            with alone_in(folder.with_name("skip"), session, lambda *_: pytest.fail("another folder is free")):
                order.append("first")
        waiting.result(20)
    assert order == ["first", "second"]
    assert "Waiting for another page" in reported[0]
    assert not folder.parent.exists()
    assert list(session.iterdir()) == []


def test_what_is_being_written_is_not_listed(tmp_path: Path) -> None:
    """Names that `pavetwin.files.writing` and `writing_folder` give what is not whole yet."""
    hidden = tmp_path / "missions" / ".hover-host-7-abc"
    whole = tmp_path / "missions" / "hover"
    for folder in (hidden, whole):
        folder.mkdir(parents=True)
        (folder / "mission.yaml").write_text("format: 5")
    (whole / ".map.png-host-7-abc.png").write_bytes(b"half")
    assert _file_names(whole, []) == ["mission.yaml"]
    report: Any = _Progress(None, None)  # type: ignore[arg-type]
    assert listed_missions({"world": str(tmp_path)}, report) == {"missions": ["hover"]}


@pytest.mark.slow
def test_pages_that_fly_the_same_mission_all_get_it(page: RunningPage) -> None:
    asked = {"do": "fly", "request": {"traffic": "low", "seed": 3, "count": 1, "policies": ["baseline", "skip"]}}
    with ThreadPoolExecutor(3) as pages:
        answers = list(pages.map(lambda _: page.ask(asked)[0], range(3)))
    done = [answer["done"] for answer in answers]
    assert done[0] == done[1] == done[2], json.dumps(answers)
    folder = Path(done[0]["folder"])
    assert set(done[0]["files"]) == set(digests(folder))
    for name in done[0]["files"]:
        assert page.get(f"/api/played/{done[0]['key']}/files/{name}").status == 200
    assert not [path.name for path in page.session.folder.iterdir() if path.name.startswith((".", "mission-"))]


def failing(error: Exception) -> SimpleNamespace:
    """Tasks that all fail so."""

    def run(task: Mapping[str, Any], progress: Any) -> Mapping[str, Any]:  # noqa: ARG001
        raise error

    return SimpleNamespace(run=run)


def test_a_fault_of_the_program_leaves_its_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    reply = _reply(failing(TypeError("of all things")), {}, None)
    assert "of all things" in reply["error"]
    reported = capfd.readouterr().err
    assert "Traceback" in reported
    assert "in run" in reported
    assert _reply(failing(PaveTwinError("The town is gone.")), {}, None) == {"error": "The town is gone."}
    assert capfd.readouterr().err == ""


def test_the_process_answers_a_fault_and_goes_on() -> None:
    words = [sys.executable, "-m", "pavetwin.app.task_process"]
    with subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for _ in range(2):
            process.stdin.write(json.dumps({"do": "nothing"}) + "\n")
            process.stdin.flush()
            assert "error" in json.loads(process.stdout.readline())
        process.stdin.close()


def test_a_plan_format_of_a_plugin_can_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [*PLAN_FORMATS.names(), "kml"]
    monkeypatch.setattr(PLAN_FORMATS, "names", lambda: names)
    assert "kml" in [each["name"] for each in exports()]
    task = {"what": "exe", "made": "made", "results": "results"}
    with pytest.raises(PaveTwinError, match=r"no kind of file 'exe'.* known are html, .*kml"):
        make_export(task, lambda _share, _what: None)

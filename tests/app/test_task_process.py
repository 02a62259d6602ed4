"""What the process that runs the page's tasks answers where a task fails."""

import json
import subprocess
import sys
from collections.abc import Mapping
from subprocess import PIPE
from types import SimpleNamespace
from typing import Any

import pytest

from pavetwin.app.exports import exports, make_export
from pavetwin.app.task_process import _reply
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import PLAN_FORMATS


def failing(error: Exception) -> SimpleNamespace:
    """Tasks that all fail so."""

    def run(task: Mapping[str, Any], progress: Any) -> Mapping[str, Any]:  # noqa: ARG001
        raise error

    return SimpleNamespace(run=run)


def test_a_fault_of_the_program_leaves_its_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    reply = _reply(failing(TypeError("of all things")), {}, None)
    assert "of all things" in reply["error"]
    told = capfd.readouterr().err
    assert "Traceback" in told
    assert "in run" in told
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

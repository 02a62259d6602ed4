"""Exports of missions: a page that plays offline, and recordings for Rerun."""

import json
import re
import sys
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.app import exports as page
from pavetwin.app.exports import EVERY_S, is_installed, write_rerun
from pavetwin.app.playback import write_playback
from pavetwin.app.street_map import packed_map
from pavetwin.errors import PaveTwinError
from pavetwin.mission.timeline import Timeline
from scenes import tiny

RELATIVE = re.compile(r"from\s*['\"]\.")


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the browser plays of two missions, and the map."""
    folder = tmp_path_factory.mktemp("replay")
    results = [tiny.result("queue_at_light", policy) for policy in ("hover", "skip")]
    write_playback(results, folder, step_s=0.5)
    (folder / "town.json").write_bytes(packed_map(results[0].environment.world))
    return folder


@pytest.fixture(scope="module")
def text(played: Path) -> str:
    return page.replay_page(played, played / "town.json", 'my "first" <mission>').decode()


def test_the_page_holds_every_file_of_the_mission_and_the_map(played: Path, text: str) -> None:
    held = dict(re.findall(r'data-file="([^"]+)">([^<]+)</script>', text))
    files = {path.name: path for path in played.glob("*.gz")}
    assert len(files) >= 2
    assert held.keys() == {"map", *(f"api/played/replay/{name}" for name in files)}
    assert b64decode(held.pop("map")) == (played / "town.json").read_bytes()
    for place, content in held.items():
        assert b64decode(content) == files[Path(place).name].read_bytes()


def test_the_modules_are_the_pages_own_and_import_nothing_from_outside(text: str) -> None:
    (listed,) = re.findall(r'<script type="importmap">(.+?)</script>', text)
    modules = {
        name: b64decode(url.removeprefix("data:text/javascript;base64,")).decode()
        for name, url in json.loads(listed)["imports"].items()
    }
    assert {"pavetwin/replay.js", "pavetwin/player.js", "pavetwin/map.js", "pavetwin/server.js"} <= modules.keys()
    assert "pavetwin/main.js" not in modules
    assert "WebSocket" not in modules["pavetwin/server.js"], "another module stands in for the one that asks a server"
    for name, module in modules.items():
        own = (page.STATIC / page.INSTEAD.get(Path(name).name, Path(name).name)).read_text(encoding="utf-8")
        assert module == re.sub(r"(from\s*['\"])\./", r"\1pavetwin/", own)
        assert not RELATIVE.search(module)
        assert set(re.findall(r"from\s*['\"](pavetwin/[\w.-]+)['\"]", module)) <= modules.keys()


def test_the_page_asks_nobody_for_anything(text: str) -> None:
    assert "static/" not in text
    assert not re.search(r"""(?:src|href)=["'](?!data:)""", text)
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy
    assert "http" not in policy
    assert 'content="my &quot;first&quot; &lt;mission&gt;"' in text
    assert "uplot" in text.split("-->")[0], "the licences of what is inside"


def test_a_page_that_browsers_would_not_open_is_refused(played: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LARGEST_BYTES", 1_000_000)
    with pytest.raises(PaveTwinError, match=r"would have \d MB, and browsers take up to 1 MB"):
        page.replay_page(played, played / "town.json", "m")


STAND_IN = '''
"""What PaveTwin calls of rerun-sdk 0.41: it writes what is logged as lines of JSON."""
import json
import numpy as np

class RecordingStream:
    def __init__(self, application_id):
        self.application_id, self.time_s, self.lines = application_id, None, []

    def save(self, path):
        self.path = path

    def set_time(self, timeline, *, duration):
        self.time_s = duration

    def log(self, entity_path, entity, *, static=False):
        self.lines.append({"path": entity_path, "t": None if static else self.time_s, **entity})

    def flush(self):
        with open(self.path, "w") as file:
            file.writelines(json.dumps(line) + "\\n" for line in self.lines)

def _plain(values):
    return [np.asarray(each).tolist() for each in values]

def Points3D(positions, *, radii=None, colors=None, labels=None, show_labels=None):
    return {"points": _plain(positions), "labels": labels}

def LineStrips3D(strips):
    return {"strips": _plain(strips)}

def Scalars(scalars):
    return {"scalar": float(scalars)}

def Boxes3D(*, centers, half_sizes, quaternions, colors):
    assert len(centers) == len(half_sizes) == len(quaternions) == len(colors)
    return {"centers": _plain(centers), "half_sizes": _plain(half_sizes)}
'''


@pytest.fixture
def logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What is recorded of two missions over the same traffic."""
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "rerun.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    write_rerun([tiny.result("queue_at_light", policy) for policy in ("hover", "skip")], tmp_path / "m.rrd")
    del sys.modules["rerun"]
    return [json.loads(line) for line in (tmp_path / "m.rrd").read_text().splitlines()]


def test_the_recording_has_the_uav_and_the_traffic_of_the_timeline(logged: list[dict[str, Any]]) -> None:
    result = tiny.result("queue_at_light", "hover")
    timeline = Timeline(result)
    flown = {line["t"]: line["points"][0] for line in logged if line["path"] == "hover/uav"}
    assert len(flown) == int(np.ceil(timeline.duration_s / EVERY_S))
    for time_s, point in list(flown.items())[::7]:
        state = timeline.at(time_s)
        assert point == pytest.approx([*state.uav.position, state.uav.altitude_m])
        (boxes,) = [line for line in logged if line["path"] == "traffic" and line["t"] == time_s]
        poses = result.trace.agents_at(time_s)
        assert np.allclose(np.array(boxes["centers"]).reshape(-1, 3)[:, 0], poses["x_m"])
        assert np.allclose(2 * np.array(boxes["half_sizes"]).reshape(-1, 3)[:, 2], poses["height_m"])
    found = [line["scalar"] for line in logged if line["path"] == "hover/found"]
    assert found[-1] == len(timeline.at(timeline.duration_s).found)
    assert {line["path"].split("/")[0] for line in logged} == {"town", "traffic", "hover", "skip"}


def test_the_recording_names_what_became_of_each_defect(logged: list[dict[str, Any]]) -> None:
    (defects,) = [line for line in logged if line["path"] == "skip/defects"]
    judged = tiny.result("queue_at_light", "skip").inspected_defects
    for each in judged:
        assert any(f" {each.defect.id}: {'found' if each.is_found else 'missed'}" in text for text in defects["labels"])


@pytest.mark.skipif(is_installed(), reason="rerun is installed here")
def test_without_rerun_one_line_names_the_package(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="pip install rerun-sdk"):
        write_rerun([tiny.result("queue_at_light", "hover")], tmp_path / "m.rrd")
    assert not list(tmp_path.iterdir())

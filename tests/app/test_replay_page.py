"""The page that plays missions without a server: one file with all in it, which asks nobody for anything."""

import json
import re
from base64 import b64decode
from pathlib import Path

import pytest

from pavetwin.app import exports as page
from pavetwin.app.playback import write_playback
from pavetwin.app.street_map import packed_map
from pavetwin.errors import PaveTwinError
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
    assert 'content="my &quot;first&quot; &lt;mission>"' in text
    assert "uplot" in text.split("-->")[0], "the licences of what is inside"


def test_a_page_that_browsers_would_not_open_is_refused(played: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LARGEST_BYTES", 1_000_000)
    with pytest.raises(PaveTwinError, match=r"would have \d MB, and browsers take up to 1 MB"):
        page.replay_page(played, played / "town.json", "m")

"""The files of the town in 3-D over HTTP: by their names in the manifest and no others, from one process that stays."""

import asyncio
import gzip
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pavetwin.app.task_pool import KeptProcess
from pavetwin.errors import PaveTwinError
from pavetwin.scene.web.town import FACADES, LEAVES
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.page import RunningPage, running_page
from scenes.processes import children, command_line, is_gone, is_over

TILE = "/town/w0/2/{}_{}.glb.gz"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("town-files") / "cross"
    save_world(built("cross"), folder)
    return folder


def processes() -> set[int]:
    return {child for child in children(os.getpid()) if b"pavetwin.app.task_process" in command_line(child)}


@pytest.mark.slow
def test_the_manifest_and_the_tiles_that_it_lists_are_served(page: RunningPage, world: Path) -> None:
    before = processes()
    answer = page.get("/town/w0/manifest.json")
    assert answer.status == 200
    assert answer.headers["Content-Type"].startswith("application/json")
    manifest = answer.values
    base = load_world(world).base
    assert manifest["base"] == pytest.approx([base.x, base.y], abs=0.01)
    column, row = manifest["levels"][2]["tiles"][0][:2]
    with ThreadPoolExecutor(4) as several:
        first, *others = several.map(page.get, [TILE.format(column, row)] * 4)
    assert first.status == 200
    assert gzip.decompress(first.body)[:4] == b"glTF"
    assert all(other.body == first.body for other in others)
    assert len(processes() - before) == 1, "one process makes all files"
    again = page.get(TILE.format(column, row), If_None_Match=first.headers["ETag"])
    assert (again.status, again.body) == (304, b"")
    assert page.get("/town/w0/leaves.png").body[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    "name",
    [
        "2/99999_0.glb.gz",
        "9/0_0.glb.gz",
        "0/0_0.glb",
        "nothing",
        "../manifest.json",
        "..%2fmanifest.json",
        "..%2f..%2fworld.yaml",
        "2/..%2f..%2fworld.yaml",
        "%2fetc%2fpasswd",
        "defects/0_0_9999.glb.gz",
        f"{FACADES}%00",
        "x" * 5000,
    ],
)
def test_other_names_are_not_found(page: RunningPage, name: str) -> None:
    answer = page.get(f"/town/w0/{name}")
    assert answer.status == 404
    assert "error" in answer.values


def test_unknown_worlds_are_not_found(page: RunningPage) -> None:
    for key in ("w1", "x", "..%2fw0"):
        assert page.get(f"/town/{key}/manifest.json").status == 404


def test_without_the_token_no_file_is_served(page: RunningPage) -> None:
    for name in ("manifest.json", LEAVES):
        assert page.get(f"/town/w0/{name}", Cookie="").status == 403
        assert page.get(f"/town/w0/{name}", Origin="http://evil.example").status == 403


@pytest.mark.slow
def test_a_process_that_died_is_replaced_and_the_last_ends_with_the_server(world: Path) -> None:
    before = processes()
    with running_page([world]) as own:
        assert own.get("/town/w0/manifest.json").status == 200
        (first,) = processes() - before
        os.kill(first, signal.SIGKILL)
        assert is_over(lambda: is_gone(first))
        assert own.get("/town/w0/manifest.json").status == 200
        (second,) = processes() - before
    assert is_over(lambda: is_gone(second))


def test_a_closed_one_starts_no_process() -> None:
    async def late() -> None:
        kept = KeptProcess()
        await kept.close()
        await kept.run({"do": "town"})

    before = processes()
    with pytest.raises(PaveTwinError, match="ends"):
        asyncio.run(late())
    assert processes() == before

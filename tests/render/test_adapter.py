"""Commands without a Vulkan adapter, and the cached header of the graphics library."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.store import save_world
from scenes import built

NOWHERE = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"}
TESTS = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])


def without_an_adapter(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **NOWHERE, "PYTHONPATH": TESTS}
    )


def test_a_renderer_names_the_package_that_is_missing() -> None:
    done = without_an_adapter(
        "from pavetwin.errors import PaveTwinError\n"
        "from pavetwin.render.renderer import Renderer\n"
        "from scenes.stage import Plane\n"
        "try:\n    Renderer(Plane())\nexcept PaveTwinError as error:\n    print(error)\n"
    )
    assert done.stdout.count("\n") == 1
    assert "mesa-vulkan-drivers" in done.stdout


def pavetwin(*arguments: object) -> subprocess.CompletedProcess[str]:
    return without_an_adapter("from pavetwin.cli import main; main()", *arguments)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("without") / "cross"
    save_world(built("cross"), folder)
    return folder


def test_worlds_are_built_all_the_same(tmp_path: Path) -> None:
    done = pavetwin("world", "build", "--generate", "grid", "--defects-per-segment", 0, "-o", tmp_path / "grid")
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_worlds_are_exported_all_the_same(world: Path, tmp_path: Path) -> None:
    exported = pavetwin("world", "export", world, tmp_path / "part.glb", "--segment", "s0001", "--texel", 0.1)
    assert exported.returncode == 0, exported.stderr
    assert (tmp_path / "part.glb").read_bytes()[:4] == b"glTF"


@pytest.mark.parametrize(
    "arguments",
    [("fly", "--density", "low", "--segments", 1, "--save-frames", "hits"), ("capture", "--images", 1)],
    ids=str,
)
def test_what_draws_is_refused_in_one_line_and_leaves_nothing(
    world: Path, tmp_path: Path, arguments: tuple[object, ...]
) -> None:
    before = sorted(world.rglob("*"))
    done = pavetwin(arguments[0], world, "-o", tmp_path / "made", *arguments[1:])
    assert done.returncode == 2
    assert done.stdout == ""
    # On a slow machine it is said first what is being done.
    (line,) = [line for line in done.stderr.splitlines() if not line.endswith(" …")]
    assert line.startswith("Error: ")
    assert "mesa-vulkan-drivers" in line
    assert not (tmp_path / "made").exists()
    assert sorted(world.rglob("*")) == before


@pytest.mark.slow
def test_traffic_is_recorded_and_missions_fly_all_the_same(world: Path, tmp_path: Path) -> None:
    recorded = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1)
    assert recorded.returncode == 0, recorded.stderr
    result = pavetwin("fly", world, "--density", "low", "--seed", 1, "--segments", 1, "-o", tmp_path / "m")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "m" / "mission.parquet").is_file()


def test_a_second_request_reports_the_same() -> None:
    """A failure is not remembered, and must not change what is said the second time."""
    script = """
from pavetwin.errors import PaveTwinError
from pavetwin.render.adapter import find_adapter
for _ in range(2):
    try:
        find_adapter()
    except PaveTwinError as error:
        print(error)
"""
    nowhere = {**os.environ, "VK_ICD_FILENAMES": "/nowhere", "VK_DRIVER_FILES": "/nowhere"}
    done = subprocess.run([sys.executable, "-c", script], env=nowhere, capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    assert first == second
    assert "mesa-vulkan-drivers" in first


PROGRAM = """
import cffi
from cffi import cparser

parsed, parse = [], cparser.Parser.parse
cparser.Parser.parse = lambda self, *given, **named: (parsed.append(1), parse(self, *given, **named))[1]
from pavetwin.render.adapter import load_wgpu

given = cffi.FFI
load_wgpu()
from wgpu.backends import wgpu_native

assert cffi.FFI is given
functions = [name for name in dir(wgpu_native.lib) if name.startswith("wgpu")]
limits = wgpu_native.ffi.new("WGPULimits *")
print(len(parsed), len(functions), wgpu_native.ffi.sizeof(limits[0]), wgpu_native.lib.WGPUBackendType_Vulkan)
"""


def loaded(cache: Path) -> tuple[int, tuple[int, ...]]:
    """How often a process parsed; and what it knows of the library."""
    environment = {**os.environ, CACHE_VARIABLE: str(cache)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    parsed, *known = map(int, done.stdout.split())
    return parsed, tuple(known)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def test_the_second_process_does_not_parse_the_header(cache: Path) -> None:
    first, known = loaded(cache)
    assert first == 1
    assert known[0] > 100
    assert loaded(cache) == (0, known)


def test_a_damaged_file_is_parsed_again(cache: Path) -> None:
    _, known = loaded(cache)
    (path,) = cache.rglob("header-*")
    whole = path.read_bytes()
    middle = len(whole) // 2
    path.write_bytes(whole[:middle] + b"damaged" + whole[middle + 7 :])
    assert loaded(cache) == (1, known)
    assert path.read_bytes() == whole


def test_without_a_cache_each_process_parses(tmp_path: Path, cache: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    assert loaded(tmp_path / "file") == (1, loaded(cache)[1])

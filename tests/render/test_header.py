"""wgpu's header is parsed once for all processes, and its library is the same whether it was parsed or not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pavetwin.world.folder import CACHE_VARIABLE

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

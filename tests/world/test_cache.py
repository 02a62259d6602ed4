"""The bound of the cache, and values kept in it."""

import os
import shutil
import time
from enum import Enum, StrEnum
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.world import cache as kept
from pavetwin.world.cache import SIZE_VARIABLE, cache_size, make_room, mark_used, most_bytes
from pavetwin.world.folder import CACHE_VARIABLE

DAY_S = 86_400.0


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of at most 10 kB."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setenv(SIZE_VARIABLE, "0.00001")
    return tmp_path


def put(path: Path, *, used_before_s: float, size: int = 3_000) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(size))
    then = time.time() - used_before_s
    os.utime(path, (then, then))
    return path


def test_the_least_recently_used_file_is_removed_first(cache: Path) -> None:
    tiles = [put(cache / "tiles" / "a" / f"{n}_0" / "maps", used_before_s=1000.0 - n) for n in range(4)]
    placed = put(cache / "defects" / "a", used_before_s=2000.0)
    make_room()
    assert not placed.exists()
    assert [path.exists() for path in tiles] == [False, True, True, True]
    assert not tiles[0].parent.exists(), "an empty folder is not left behind"
    put(cache / "textures" / "grain.npz", used_before_s=0.0)
    mark_used(tiles[1])
    make_room()
    assert [path.exists() for path in tiles] == [False, True, False, True]


def test_nothing_is_removed_below_the_bound(cache: Path) -> None:
    old = put(cache / "tiles" / "a" / "maps", used_before_s=400 * DAY_S)
    make_room()
    assert old.exists()


def test_recordings_in_use_stay_and_others_are_removed(cache: Path) -> None:
    in_use = put(cache / "worlds" / "a" / "traffic" / "high-1.parquet", used_before_s=DAY_S / 2, size=9_000)
    old = put(cache / "worlds" / "a" / "traffic" / "high-2.parquet", used_before_s=2 * DAY_S)
    tile = put(cache / "tiles" / "a" / "maps", used_before_s=10.0)
    make_room()
    assert (in_use.exists(), old.exists(), tile.exists()) == (True, False, False)


def test_files_of_others_and_those_being_written_stay(cache: Path) -> None:
    foreign = put(cache / "thesis.txt", used_before_s=400 * DAY_S, size=20_000)
    half = put(cache / "tiles" / "a" / ".maps-host-1-x", used_before_s=DAY_S, size=20_000)
    put(cache / "tiles" / "a" / "maps", used_before_s=10.0, size=12_000)
    make_room()
    assert foreign.exists()
    assert half.exists()


@pytest.mark.parametrize("bound", ["plenty", "0", "-1", "inf", "nan"])
def test_an_invalid_bound_is_reported(bound: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SIZE_VARIABLE, bound)
    with pytest.raises(PaveTwinError, match=f"{SIZE_VARIABLE} is '{bound}'; give the most"):
        most_bytes()


def test_folders_that_another_process_removes_meanwhile_are_passed_over(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiles = [put(cache / "tiles" / name / "maps", used_before_s=100.0) for name in "abcdef"]
    stat = Path.stat

    def removing(path: Path, **options: bool) -> os.stat_result:
        found = stat(path, **options)
        if path in tiles:
            for other in tiles:
                if other != path and other.parent.exists():
                    shutil.rmtree(other.parent)
        return found

    monkeypatch.setattr(Path, "stat", removing)
    assert cache_size() == (0, 3_000)


class Kind(Enum):
    CRACK = 1


class Look(StrEnum):
    WORN = "worn"


def test_bytecode_and_hidden_files_are_no_part_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They appear and go while other processes start."""
    package = tmp_path / "pavetwin"
    for folder in ("world", "defects"):
        (package / folder / "__pycache__").mkdir(parents=True)
        (package / folder / "rule.py").write_text(folder)
    code = package / "arrays.py"
    code.write_text("a = 1\n")
    (package / "seeds.py").write_text("b = 1\n")
    monkeypatch.setattr(kept, "arrays_file", str(code))
    made_by = kept.made_by.__wrapped__
    before = made_by("world", "defects")
    for name in ("__pycache__/model.cpython-311.pyc", "__pycache__/model.cpython-311.pyc.140234", ".model.py.swp"):
        (package / "world" / name).write_bytes(b"x")
    assert made_by("world", "defects") == before
    (package / "world" / "levels.yaml").write_text("b: 2\n")
    assert made_by("world", "defects") != before
    assert made_by("defects") not in (before, made_by("world", "defects"))


@pytest.mark.parametrize(
    "reduced", [Enum.__reduce_ex__, lambda member, _protocol: (getattr, (type(member), member.name))]
)
def test_members_of_enumerations_are_read_again(
    reduced: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also those that are pickled by their name, as Python 3.11.2 does."""
    for each in (Kind, Look):
        monkeypatch.setattr(each, "__reduce_ex__", reduced)
    store, value = kept.ValueStore("values", (Kind, Look)), ([Kind.CRACK, Look.WORN], {Look.WORN: Kind.CRACK})
    assert store.kept(tmp_path / "value", lambda: value) == value
    assert store.kept(tmp_path / "value", lambda: pytest.fail("made, and not read")) == value

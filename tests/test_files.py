"""Files are whole or not there; what a killed process left is cleared by the next that writes the same."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, staging_folder, working_in, writing, writing_folder

KILLED_WHILE_WRITING = """
import os, signal, sys
from pathlib import Path
from pavetwin.files import writing, writing_folder
target = Path(sys.argv[2])
with (writing if sys.argv[1] == "file" else writing_folder)(target) as temporary:
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("what", ["file", "folder"])
def test_what_a_killed_process_left_is_cleared(tmp_path: Path, what: str) -> None:
    target = tmp_path / "result.txt"
    killed = subprocess.run([sys.executable, "-c", KILLED_WHILE_WRITING, what, target], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert not target.exists()
    assert len(list(tmp_path.iterdir())) == 1  # its temporary
    if what == "file":
        with writing(target) as temporary:
            temporary.write_text("whole")
    else:
        with writing_folder(target) as temporary:
            (temporary / "part").write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["result.txt"]


def test_what_a_living_process_writes_is_left_alone(tmp_path: Path) -> None:
    with writing(tmp_path / "a.txt") as first, writing(tmp_path / "a.txt") as second:
        assert first.exists()
        assert first != second
        assert str(os.getpid()) in first.name


def test_an_exception_leaves_the_former_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("former")

    def fail() -> None:
        with writing(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["former"]


WORKS_UNTIL_KILLED = """
import sys, time
from pathlib import Path
from pavetwin.files import working_in
with working_in(Path(sys.argv[1])):
    print("at work", flush=True)
    time.sleep(60)
"""


def test_two_processes_do_not_work_in_one_folder(tmp_path: Path) -> None:
    """And a killed one stands in nobody's way."""
    folder = tmp_path / "dataset"
    with subprocess.Popen(
        [sys.executable, "-c", WORKS_UNTIL_KILLED, folder], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "at work\n"
        with pytest.raises(PaveTwinError, match=r"Another process is at work in '.*dataset'"), working_in(folder):
            pass
        other.kill()
    with working_in(folder):
        assert not folder.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_file_elsewhere_that_is_gone_is_named(tmp_path: Path) -> None:
    """For example a tile that another process removed; the folder being written is in order."""
    with (
        pytest.raises(PaveTwinError, match="'/gone/tile' no longer exists"),
        staging_folder(tmp_path / "out" / "images"),
    ):
        Path("/gone/tile").read_bytes()
    with pytest.raises(PaveTwinError, match="nothing can be made there"), writing(Path("/proc/nothing/m")):
        pass


@pytest.mark.parametrize("found", [None, 0, 2, "1", True, 1.0])
def test_only_the_present_format_is_read(found: object) -> None:
    check_format(FORMAT, "The table")
    with pytest.raises(PaveTwinError, match=r"^The table .*reads only format 1"):
        check_format(found, "The table")

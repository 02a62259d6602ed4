"""Tasks in worker processes: all run once, whatever dies; errors keep their words; nothing outlives the pool."""

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from pavetwin import workers
from pavetwin.errors import CacheWarning, PaveTwinError
from pavetwin.workers import ATTEMPTS, OnTick, WorkerPool, default_jobs, started
from scenes.processes import is_gone, is_over

OWNER = """
import sys
from functools import partial
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_workers import sleeper
from pavetwin.workers import WorkerPool

if __name__ == "__main__":
    with WorkerPool(2, partial(sleeper, Path({folder!r}))) as pool:
        pool.run(range(2), print, give_up=print)
"""


def squares(on_tick: OnTick) -> Callable[[int], int]:
    def work(task: int) -> int:
        on_tick()
        return task * task

    return work


def deadly(folder: Path, on_tick: OnTick) -> Callable[[str], str]:  # noqa: ARG001 - the signature of a start
    """`once` kills its first worker, `always` each; the others take long enough to be in work meanwhile."""

    def work(task: str) -> str:
        if task == "always" or (task == "once" and not (folder / task).exists()):
            (folder / task).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.3)
        return task.upper()

    return work


def broken(on_tick: OnTick) -> Callable[[int], int]:  # noqa: ARG001
    raise PaveTwinError("The world is damaged.")


class UnpicklableError(Exception):
    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} and {other}")


def unpicklable(on_tick: OnTick) -> Callable[[int], int]:  # noqa: ARG001
    raise UnpicklableError("this", "that")


def sleeper(folder: Path, on_tick: OnTick) -> Callable[[int], None]:  # noqa: ARG001
    """Leaves a file with its process's number, and a file `cleared-…` when it is ended through `finally`."""

    def work(task: int) -> None:
        if task == 1:
            while not list(folder.glob("begun-0-*")):
                time.sleep(0.01)
        (folder / f"begun-{task}-{os.getpid()}").touch()
        try:
            time.sleep(600)
        finally:
            (folder / f"cleared-{task}").touch()

    return work


def ran(pool: WorkerPool, tasks: list, **options: object) -> tuple[dict, list]:
    results: dict = {}
    given_up: list = []
    pool.run(tasks, results.__setitem__, give_up=given_up.append, **options)
    return results, given_up


def own_number(on_tick: OnTick) -> Callable[[int], int]:  # noqa: ARG001
    return lambda _: os.getpid()


def test_processes_that_were_started_before_are_the_first_workers_and_end_unused() -> None:
    with started(2, "json") as waiting:
        numbers = [each.process.pid for each in waiting]
        found: list[int] = []
        with WorkerPool(1, own_number, waiting=waiting) as pool:
            pool.run([0, 1], lambda _task, number: found.append(number), give_up=print)
        assert found == [numbers[0]] * 2
        assert not is_gone(numbers[1] or 0)
    waiting[1].process.join(20)
    assert waiting[1].process.exitcode == 0


def test_every_task_runs_once_and_progress_is_reported() -> None:
    ticks: list[int] = []
    with WorkerPool(2, squares, lambda: ticks.append(1)) as pool:
        assert ran(pool, list(range(7))) == ({task: task**2 for task in range(7)}, [])
        assert len(ticks) == 7
        assert ran(pool, [9]) == ({9: 81}, []), "the same workers take more"


def leave_number(folder: Path) -> None:
    (folder / f"ahead-{os.getpid()}").touch()


def fails_ahead() -> None:
    raise OSError("too early")


def numbers_ahead(folder: Path, on_tick: OnTick) -> Callable[[int], bool]:  # noqa: ARG001
    """True if this process was started ahead of its tasks."""
    return lambda _: (folder / f"ahead-{os.getpid()}").exists()


def warns(on_tick: OnTick) -> Callable[[int], int]:  # noqa: ARG001
    def work(task: int) -> int:
        warnings.warn("The cache is damaged.", CacheWarning, stacklevel=1)
        warnings.warn("Something of a library's.", DeprecationWarning, stacklevel=1)
        return task

    return work


def test_processes_get_ahead_of_their_tasks(tmp_path: Path) -> None:
    with started(2, ahead=partial(leave_number, tmp_path)) as waiting:
        deadline = time.monotonic() + 60
        while len(list(tmp_path.iterdir())) < 2:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        with WorkerPool(2, partial(numbers_ahead, tmp_path), waiting=waiting) as pool:
            assert ran(pool, list(range(4))) == (dict.fromkeys(range(4), True), [])
        assert len(list(tmp_path.iterdir())) == 2


def test_what_fails_ahead_is_left_to_the_tasks() -> None:
    with started(1, ahead=fails_ahead) as waiting, WorkerPool(1, squares, waiting=waiting) as pool:
        assert ran(pool, [3]) == ({3: 9}, [])


def test_warnings_about_the_cache_reach_the_parent() -> None:
    with warnings.catch_warnings(record=True) as caught, WorkerPool(1, warns) as pool:
        warnings.simplefilter("once")
        assert ran(pool, [1, 2]) == ({1: 1, 2: 2}, [])
    assert [(each.category, str(each.message)) for each in caught] == [(CacheWarning, "The cache is damaged.")]


def test_a_worker_that_dies_is_replaced_and_costs_other_tasks_nothing(tmp_path: Path) -> None:
    with WorkerPool(2, partial(deadly, tmp_path)) as pool:
        results, given_up = ran(pool, ["always", "a", "once", "b", "c"])
    assert results == {"a": "A", "once": "ONCE", "b": "B", "c": "C"}
    assert given_up == ["always"]


def test_what_remains_of_a_lost_task_is_asked_for(tmp_path: Path) -> None:
    asked: list[str] = []

    def remaining(task: str) -> list[str]:
        asked.append(task)
        return [] if len(asked) == ATTEMPTS - 1 else [task]

    with WorkerPool(1, partial(deadly, tmp_path)) as pool:
        assert ran(pool, ["always"], remaining=remaining) == ({}, [])
    assert asked == ["always"] * (ATTEMPTS - 1)


def test_an_error_keeps_its_words_and_its_place() -> None:
    with WorkerPool(2, broken) as pool, pytest.raises(PaveTwinError) as caught:
        ran(pool, [1, 2])
    assert str(caught.value) == "The world is damaged."
    assert "in broken" in caught.value.__notes__[0]


def test_an_error_that_cannot_be_sent_keeps_its_name_and_place() -> None:
    reported = pytest.raises(RuntimeError, match="UnpicklableError: this and that")
    with WorkerPool(1, unpicklable) as pool, reported as caught:
        ran(pool, [1])
    assert "in unpicklable" in caught.value.__notes__[0]


def test_workers_are_ended_through_their_finally_blocks(tmp_path: Path) -> None:
    def fail() -> None:
        raise KeyboardInterrupt

    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), WorkerPool(3, partial(sleeper_and_ticker, tmp_path), fail) as pool:
        ran(pool, [0, 1, 2])
    assert time.monotonic() - begun < 30
    assert {path.name for path in tmp_path.glob("cleared-*")} == {"cleared-0", "cleared-1"}
    assert all(is_gone(int(path.name.rpartition("-")[2])) for path in tmp_path.glob("begun-*"))


def sleeper_and_ticker(folder: Path, on_tick: OnTick) -> Callable[[int], None]:
    def work(task: int) -> None:
        if task < 2:
            sleeper(folder, on_tick)(task)
        while len(list(folder.glob("begun-*"))) < 2:
            time.sleep(0.01)
        on_tick()

    return work


def test_workers_of_a_killed_parent_end(tmp_path: Path) -> None:
    script = tmp_path / "owner.py"
    script.write_text(OWNER.format(tests=str(Path(__file__).parent), folder=str(tmp_path)))
    with subprocess.Popen([sys.executable, script]) as owner:
        assert is_over(lambda: len(list(tmp_path.glob("begun-*"))) == 2)
        workers = [int(path.name.rpartition("-")[2]) for path in tmp_path.glob("begun-*")]
        owner.kill()
        owner.wait()
        assert is_over(lambda: all(map(is_gone, workers)))


@pytest.mark.parametrize(
    ("cores", "spare_gib", "images", "jobs"),
    [(8, 64, 500, 8), (8, 7, 500, 3), (8, 1, 500, 1), (8, 64, 25, 2), (8, 64, 1, 1), (1, 64, 500, 1)],
)
def test_jobs_are_bounded_by_cores_memory_and_images(
    monkeypatch: pytest.MonkeyPatch, cores: int, spare_gib: int, images: int, jobs: int
) -> None:
    monkeypatch.setattr(workers, "_spare_bytes", lambda: spare_gib * 2**30)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
    assert default_jobs(images) == jobs

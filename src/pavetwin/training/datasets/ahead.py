"""Work on pictures in threads, a few ahead of the one written, in order: memory does not grow with a dataset."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, TypeVar

THREADS: Final = 2
AHEAD: Final = 8
"""Pieces of work that are begun before the first of them is used."""

Work = TypeVar("Work")
Made = TypeVar("Made")


def made_ahead(
    found: Iterator[Work], make: Callable[[Work], Made], *, exists: Callable[[Work], bool]
) -> Iterator[tuple[Work, Future[Made] | None]]:
    """Each piece of work with its result on the way, in the order given; None where the result exists already."""
    with ThreadPoolExecutor(THREADS) as threads:
        waiting: deque[tuple[Work, Future[Made] | None]] = deque()
        for work in found:
            waiting.append((work, None if exists(work) else threads.submit(make, work)))
            if len(waiting) > AHEAD:
                yield waiting.popleft()
        while waiting:
            yield waiting.popleft()

"""Who is told how far a task of the page is."""

from collections.abc import Mapping
from typing import Any, Protocol


class TaskReport(Protocol):
    """Who is told how far a task is."""

    def __call__(self, share: float, what: str, /) -> None:
        """The share done, 0 … 1, and what is being done."""

    def ready(self, values: Mapping[str, Any], /) -> None:
        """What can be used already, while the task goes on."""

    def live(self, values: Mapping[str, Any], /) -> None:
        """What is now, in a task that goes on with the clock."""

    def said(self) -> list[Mapping[str, Any]]:
        """What was said to the task since, in its order."""
        ...

"""Reports of tasks to the page: progress, and errors in one line."""

from collections.abc import Mapping
from typing import Any, Protocol

from pavetwin.errors import PaveTwinError
from pavetwin.files import hint


class TaskReport(Protocol):
    """Channel of a task to the page."""

    def __call__(self, share: float, what: str, /) -> None:
        """The share done, 0 … 1, and what is being done."""

    def ready(self, values: Mapping[str, Any], /) -> None:
        """Report data that is usable while the task continues."""

    def live(self, values: Mapping[str, Any], /) -> None:
        """Report the present state of a task that runs with the clock."""

    def messages(self) -> list[Mapping[str, Any]]:
        """Messages to the task since the last call, in order."""
        ...


def failure_words(error: Exception) -> str:
    """One line: what is known of it, or that it is a mistake of ours."""
    if isinstance(error, PaveTwinError):
        return str(error)
    if isinstance(error, MemoryError):
        return "It needs more memory than the page may use."
    if isinstance(error, OSError):
        place = f" ('{error.filename}')" if error.filename else ""
        return f"The server could not do this: {error.strerror or error}{place}. {hint(error, 'try it again')}."
    return f"Unexpected failure: {type(error).__name__}: {' '.join(str(error).split())}. Please report it."

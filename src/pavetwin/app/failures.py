"""What a page is told of a task that failed."""

from pavetwin.errors import PaveTwinError
from pavetwin.files import hint


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

"""The one exception that a user may see: a plain sentence that says what is wrong, where, and how to mend it."""

from collections.abc import Iterable
from difflib import get_close_matches


class PaveTwinError(Exception):
    """Something the user can mend. The command line prints the message as one line and exits with code 2."""


def nearest_name(word: str, known: Iterable[str]) -> str:
    """` (did you mean 'hover'?)` for the known name closest to `word`, or an empty string when none is near."""
    match = get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean '{match[0]}'?)" if match else ""

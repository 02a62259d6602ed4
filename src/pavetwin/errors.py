"""The one exception that a user may see: a plain sentence that says what is wrong, where, and how to fix it."""

import re
from collections.abc import Iterable
from difflib import get_close_matches


class PaveTwinError(Exception):
    """Something the user can fix. The command line prints the message as one line and exits with code 2.

    A message names a parameter of the library in backquotes (`altitude_m`); `cli/flags.py` turns it into an option.
    """


def nearest_name(word: str, known: Iterable[str]) -> str:
    """` (did you mean 'hover'?)` for the known name closest to `word`, or an empty string when none is near.

    Of numbered names (`s0001`) the one of the same number is the closest to `s1`, `S01` or `1`.
    """
    names = list(known)
    match = _same_number(word, names) or get_close_matches(word, names, n=1, cutoff=0.5)
    return f" (did you mean '{match[0]}'?)" if match else ""


def _same_number(word: str, names: Iterable[str]) -> list[str]:
    asked = _NUMBERED.fullmatch(word)
    if asked is None:
        return []
    letters, number = asked[1].lower(), int(asked[2])
    parts = ((name, _NUMBERED.fullmatch(name)) for name in names)
    return [name for name, it in parts if it and int(it[2]) == number and letters in ("", it[1].lower())]


_NUMBERED = re.compile(r"([A-Za-z]*)(\d+)", re.ASCII)

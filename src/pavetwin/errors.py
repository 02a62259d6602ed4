"""The exception for users: a plain sentence that names the fault, its place and the fix."""

import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import SequenceMatcher, get_close_matches
from operator import eq
from pathlib import Path
from sysconfig import get_paths


class PaveTwinError(Exception):
    """Something the user can fix. The command line prints the message as one line and exits with code 2.

    A message names a parameter of the library in backquotes (`altitude_m`), in whose place a command shows its option,
    and a command as it is typed (`pavetwin world build SOURCE --force`). It is never empty: without a text, as may come
    from a plugin, it names the type of the failure.
    """

    def __str__(self) -> str:
        return super().__str__().strip() or f"{type(self.__cause__ or self).__name__} without a message."


class CacheWarning(UserWarning):
    """The cache is damaged or cannot be written, and what it should hold is made again. The results are the same."""


@contextmanager
def naming(names: Mapping[str, str], where: str = "") -> Iterator[None]:
    """Errors in the block call parameters what their reader calls them: keys of a file, or an argument.

    Args:
        names: by parameter as messages name it, such as `` `policy` `` or `sensing.sensor`.
        where: comes before a message that begins with one of them, such as `the design`.
    """
    try:
        yield
    except PaveTwinError as error:
        text = told = str(error)
        for parameter, name in names.items():
            text = text.replace(parameter, name)
        raise PaveTwinError(f"{where}: {text}" if where and told.startswith(tuple(names)) else text) from error


@contextmanager
def about(parameter: str) -> Iterator[None]:
    """Errors in the block begin with the parameter whose value they are about, once."""
    try:
        yield
    except PaveTwinError as error:
        text = str(error)
        if text.startswith(f"`{parameter}`"):
            raise
        starts_plainly = text.partition(" ")[0].istitle()  # as `There`, not as `SUMO`
        raise PaveTwinError(f"`{parameter}`: {text[0].lower() if starts_plainly else text[0]}{text[1:]}") from error


def no_such(what: str, name: str, known: Iterable[str], *, key: str, instead: str = "") -> str:
    """The message about a name that is not known, with the nearest and all known ones.

    Args:
        what: it would name, such as `label format`.
        key: the parameter or setting that takes the names, as messages name it.
        instead: what may be given in place of a name.
    """
    names = list(known)
    return f"{key}: no {what} '{name}'{nearest_name(name, names)}; known are {', '.join(names)}{instead}."


def describe(error: BaseException) -> str:
    """Another error in one line: its type and its message."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def describe_with_place(error: BaseException) -> str:
    """Another error in one line, with the place in the user's own code that it comes from, or else where it arose."""
    frames = traceback.extract_tb(error.__traceback__)
    others = (str(Path(__file__).parent), *get_paths().values())
    own = [frame for frame in frames if not frame.filename.startswith(("<", *others))]
    where = (own or frames)[-1] if frames else None
    return f"{describe(error)} ({where.filename}, line {where.lineno})" if where is not None else describe(error)


def nearest_name(word: str, known: Iterable[str], compared: Callable[[str], str] = str) -> str:
    """` (did you mean 'hover'?)` for the known name closest to `word`, or an empty string when none is near.

    Of numbered names (`s0001`) the one of the same number is the closest to `s1`, `S01` or `1`; of equally close ones,
    that with most letters in the same places.

    Args:
        compared: what of a name is compared, such as its letters in lower case.
    """
    names = {compared(name): name for name in known}
    word = compared(word)
    match = _same_number(word, names) or get_close_matches(word, names, n=max(1, len(names)), cutoff=0.5)
    if not match:
        return ""
    best = max(match, key=lambda name: (SequenceMatcher(None, name, word).ratio(), sum(map(eq, name, word))))
    return f" (did you mean '{names[best]}'?)"


def _same_number(word: str, names: Iterable[str]) -> list[str]:
    asked = _NUMBERED.fullmatch(word)
    if asked is None:
        return []
    letters, number = asked[1].lower(), int(asked[2])
    parts = ((name, _NUMBERED.fullmatch(name)) for name in names)
    return [name for name, it in parts if it and int(it[2]) == number and letters in ("", it[1].lower())]


_NUMBERED = re.compile(r"([A-Za-z]*)(\d+)", re.ASCII)

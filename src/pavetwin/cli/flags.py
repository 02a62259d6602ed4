"""The library names its parameters in backquotes (`altitude_m`); the command line names the options that give them.

A parameter becomes the option of the same name where the typed command has one, or else the one that `FLAGS` names. A
command in backquotes, with its parameters as words (`pavetwin world build SOURCE output=town force`), becomes the
command as one types it.
"""

import re
from collections.abc import Sequence
from itertools import dropwhile
from typing import Any, Final

from pavetwin.errors import PaveTwinError

FLAGS: Final = {
    "altitude_m": "--altitude",
    "altitudes_m": "--altitude",
    "count": "--segments",
    "count=None": "--segments all",
    "densities": "--density",
    "every_s": "--every",
    "image_px": "--image",
    "longest_px": "--longest",
    "max_time_s": "--max-time",
    "megapixels": "--max-megapixels",
    "most_mb": "--max-mb",
    "names": "--segment",
    "objective": "--choose",
    "overrides": "--set",
    "picture=jpg": "no --png",
    "picture=png": "--png",
    "platforms": "--platform",
    "plugins": "--plugin",
    "per_100_m2": "--defects-per-100-m2",
    "per_segment": "--defects-per-segment",
    "population": "--damage",
    "recording": "--traffic",
    "retry": "--retry-failed",
    "segment_length_m": "--segment-length",
    "size_px": "--size",
    "take_off_s": "--take-off",
    "texel_m": "--texel",
    "upload_mb": "--max-mb",
}
"""Options of another name, by parameter, or by parameter and value where an option has no value of its own."""

PROGRAM: Final = "pavetwin"


def with_flags(message: str, typed: Sequence[str], group: Any) -> str:
    """A message of the library as the user of a command reads it.

    Args:
        typed: the words after the program's name.
        group: the program's commands.
    """
    command = _command(typed, group)

    def shown(found: re.Match[str]) -> str:
        text = found[1]
        if text.startswith(f"{PROGRAM} "):
            return f"`{_command_line(text, group)}`"
        return _option(text, command) or found[0]

    return re.sub(r"`([^`]+)`", shown, message)


def refuse_repeated(typed: Sequence[str], group: Any) -> None:
    """Refuse an option that takes one value and is given twice, of which the last would count.

    Raises:
        PaveTwinError: there is one.
    """
    for each in getattr(_command(typed, group), "params", ()):
        if getattr(each, "multiple", True) or getattr(each, "is_flag", True):
            continue
        if sum(word.partition("=")[0] in each.opts for word in typed) > 1:
            raise PaveTwinError(
                f"{max(each.opts, key=len)} is given more than once, and takes one value; give it once."
            )


def _command(words: Sequence[str], group: Any) -> Any:
    """The innermost command that words name, or that a group stands for without a name."""
    for word in dropwhile(lambda word: word.startswith("-"), words):
        if not hasattr(group, "get_command"):
            break
        inner = group.get_command(None, word) or group.get_command(None, getattr(group, "default_command", ""))
        if inner is None:
            break
        group = inner
    return group


def _option(parameter: str, command: Any) -> str | None:
    """The option of a command that gives a parameter; None where it has none."""
    known = {flag for each in command.params for flag in each.opts}
    for words in (f"--{parameter.replace('_', '-')}", FLAGS.get(parameter, "")):
        if known.intersection(words.split()):
            return words
    return None


def _command_line(text: str, group: Any) -> str:
    """A command whose parameters are `name=value` or a name alone, as it is typed."""
    command = _command(text.split()[1:], group)

    def typed(found: re.Match[str]) -> str:
        option = _option(found[1], command)
        return f" {option}{' ' if found[2] else ''}" if option else found[0]

    return re.sub(r" ([a-z_]+)(=|(?= |$))", typed, text)

"""Options of a policy or sensor, which declares them with their defaults."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from pavetwin.errors import PaveTwinError, nearest_name

OptionValue = float | int | str | bool


def _with_absolute_files(options: Mapping[str, OptionValue]) -> Mapping[str, OptionValue]:
    files = {name: str(path.absolute()) for name, path in option_files(options).items()}
    return {**options, **files}


def option_files(options: Mapping[str, OptionValue]) -> dict[str, Path]:
    """Existing files named by option values, such as a detector's model, by option.

    A text without a suffix and without a folder (`fast`) names no file, whatever lies in the current folder.
    """
    texts = {name: value for name, value in options.items() if isinstance(value, str)}
    paths = {name: Path(text) for name, text in texts.items() if Path(text).suffix or Path(text).name != text}
    return {name: path for name, path in paths.items() if path.is_file()}


Options = Annotated[Mapping[str, OptionValue], AfterValidator(_with_absolute_files)]
"""Option → value; the path of an existing file is made absolute."""

_TYPES: Mapping[type, str] = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


def checked_options(
    given: Mapping[str, OptionValue], defaults: Mapping[str, OptionValue], *, key: str, owner: str
) -> dict[str, OptionValue]:
    """The value of every option: the given one, or else its default.

    A value must have the type of its default; a whole number is a number too.

    Args:
        key: the setting that gives them, such as `sensing.options`.
        owner: their owner, such as `the sensor 'sharp'`.

    Raises:
        PaveTwinError: there is no such option, or a value is of another type.
    """
    for option, value in given.items():
        if option not in defaults:
            known = (
                f"{nearest_name(option, defaults)}; known are {', '.join(defaults)}" if defaults else "; it has none"
            )
            raise PaveTwinError(f"{key}: {owner} has no option '{option}'{known}.")
        wanted = type(defaults[option])
        if type(value) is not wanted and not (wanted is float and type(value) is int):
            raise PaveTwinError(
                f"{key}.{option}: {owner} expects {_TYPES[wanted]} such as {defaults[option]!r} (got {value!r})."
            )
    return {**defaults, **{name: float(it) if type(defaults[name]) is float else it for name, it in given.items()}}


def options_of_one(
    name: str,
    has: Mapping[str, Mapping[str, OptionValue]],
    given: Mapping[str, OptionValue],
    *,
    key: str,
    owners: str,
) -> dict[str, OptionValue]:
    """The given options that one of several owners has, if all share one setting.

    Args:
        has: options of each owner, by its name.
        key: the setting that gives them.
        owners: their kind, such as `sensor of the design`.

    Raises:
        PaveTwinError: none of them has an option.
    """
    known = [option for each in has.values() for option in each]
    for option in given:
        if option not in known:
            raise PaveTwinError(f"{key}: no {owners} has an option '{option}'{nearest_name(option, known)}.")
    return {option: value for option, value in given.items() if option in has[name]}

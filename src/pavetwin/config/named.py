"""Data files by name: those that ship with the package, and a user's YAML files."""

from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from yaml import YAMLError

from pavetwin.config.settings import PlacedValueError, Settings
from pavetwin.config.text import line_of, parse_yaml, why_unread
from pavetwin.errors import PaveTwinError, no_such

Data = TypeVar("Data", bound=Settings)


def _no_more(data: Settings) -> None:
    """No check beyond the schema."""


def names_in(package: str, folder: str) -> list[str]:
    """Names of the YAML files in a folder of one of our packages."""
    listed = (files(package) / folder).iterdir()
    return sorted(entry.name.removesuffix(".yaml") for entry in listed if entry.name.endswith(".yaml"))


def read_named(
    schema: type[Data],
    name: str,
    *,
    what: str,
    key: str,
    package: str,
    folder: str,
    more: Sequence[str] = (),
    check: Callable[[Data], None] = _no_more,
) -> Data:
    """The data of a name, or of a file whose name ends in .yaml or .yml.

    Args:
        what: the kind of data in messages, such as `pavement`.
        key: the parameter that takes their names.
        more: other values of that parameter, for the message.
        check: further check beyond the schema, such as of names of other files; raises `PlacedValueError`.

    Raises:
        PaveTwinError: there is no such name or file, or it does not fit the schema; the message names file, line and
            key.
    """
    if name.endswith((".yaml", ".yml")):
        try:
            text = Path(name).read_text(encoding="utf-8")
            values = parse_yaml(text, where=f"'{name}'")
        except (OSError, UnicodeDecodeError, YAMLError, ValueError) as error:
            raise PaveTwinError(f"The {what} '{name}' cannot be read: {why_unread(error)}.") from error
        if values is None:
            raise PaveTwinError(f"The {what} '{name}' is empty.")
    elif name in (known := names_in(package, folder)):
        text = (files(package) / folder / f"{name}.yaml").read_text(encoding="utf-8")
        values = parse_yaml(text, where=name)
    else:
        instead = ", or a file whose name ends in .yaml"
        raise PaveTwinError(no_such(what, name, [*known, *more], key=f"`{key}`", instead=instead))
    if not isinstance(values, dict):
        raise PaveTwinError(f"{what} '{name}': a list of keys with values is expected.")
    return checked(schema, values, text, where=f"{what} '{name}'", check=check)


def checked(
    schema: type[Data],
    values: Mapping[str, Any],
    text: str,
    where: str,
    check: Callable[[Data], None] = _no_more,
) -> Data:
    """The content of a data file, checked.

    Args:
        values: plain values of the file, by key.
        text: text of the file, for line numbers in messages.
        where: names the file in messages.
        check: as in `read_named`.

    Raises:
        PaveTwinError: a value does not fit; the message names file, line and key.
    """
    data = schema.parse(values, where, text)
    try:
        check(data)
    except PlacedValueError as error:
        place = f"{where}, line {line_of(text, error.place)}: {'.'.join(error.shown)}"
        raise PaveTwinError(f"{place}: {str(error).removesuffix('.')}.") from error
    return data

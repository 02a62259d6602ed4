"""YAML files of cameras or aircraft by name: those of the package and a user's own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import yaml

from pavetwin.config.settings import Settings
from pavetwin.config.text import parse_yaml, why_unread
from pavetwin.errors import PaveTwinError
from pavetwin.registry import Registry

S = TypeVar("S", bound=Settings)

Parse = Callable[[str, str], dict[str, S]]
"""Parser of a file's text; the second argument names the file in messages."""


def parse_entries(kind: type[S], what: str, text: str, where: str) -> dict[str, S]:
    """The values of a YAML file's text, by name.

    Args:
        what: the kind of value in messages, such as `camera`.
        where: names the file in messages.

    Raises:
        PaveTwinError: it is not valid YAML, or does not hold such values.
    """
    return {
        name: kind.parse(entry, where=f"{where}, {what} '{name}'") for name, entry in mappings_in(what, text, where)
    }


def mappings_in(what: str, text: str, where: str) -> list[tuple[str, dict[str, Any]]]:
    """The plain values of a YAML file's text, by name.

    Raises:
        PaveTwinError: it is not valid YAML, or not a mapping of mappings.
    """
    try:
        entries: Any = parse_yaml(text, where)
    except (yaml.YAMLError, ValueError) as error:  # a ValueError comes from an invalid date
        raise PaveTwinError(f"{where} is not valid YAML: {why_unread(error)}.") from error
    if not isinstance(entries, dict) or not all(isinstance(entry, dict) for entry in entries.values()):
        raise PaveTwinError(f"{where}: expected a mapping from {what} names to their values.")
    if not entries:
        raise PaveTwinError(f"{where} holds no {what}.")
    return [(str(name), entry) for name, entry in entries.items()]


def own_file(name: str) -> str | None:
    """The user's YAML file in a name such as `mine.yaml:name`; None for a registered name."""
    path = name.partition(":")[0]
    return path if path.endswith((".yaml", ".yml")) else None


def find_entry(registry: Registry[S], parse: Parse[S], name: str) -> S:
    """A value by its registered name, or from a YAML file: `my.yaml` (its only one) or `my.yaml:name`.

    Raises:
        PaveTwinError: no such name or file.
    """
    path, (_, colon, entry) = own_file(name), name.partition(":")
    if path is None:
        return registry.get(name, instead=", or a path to a YAML file")
    try:
        own = parse(Path(path).read_text(encoding="utf-8"), path)
    except OSError as error:
        raise PaveTwinError(f"{registry.key}: cannot read '{path}': {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise PaveTwinError(f"{registry.key}: '{path}' is not text in UTF-8.") from error
    if not colon and len(own) == 1:
        return next(iter(own.values()))
    if entry not in own:
        raise PaveTwinError(f"{registry.key}: '{path}' holds {', '.join(own)}; choose one as {path}:NAME.")
    return own[entry]

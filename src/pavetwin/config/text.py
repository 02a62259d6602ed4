"""Settings files as text: YAML in which no key is given twice and 10:30 is a time, not a number."""

import re
from collections.abc import Sequence
from typing import Any, Final

import yaml

from pavetwin.errors import PaveTwinError

_MERGE: Final = "tag:yaml.org,2002:merge"  # Tag of `<<`, whose keys may be repeated


_CLOCK: Final = re.compile(r"^[0-9]+(:[0-5]?[0-9])+(\.[0-9]*)?$")
"""YAML 1.1 reads 10:30 as 630, a number of base 60; YAML 1.2 has no such numbers."""

_BEGUN: Final = {
    "while parsing a flow mapping": "the braces that open",
    "while parsing a flow sequence": "the brackets that open",
    "while scanning a quoted scalar": "the quoted text that begins",
}
"""Constructs without an end, by PyYAML's context: it reports the error where it notices it, lines further on."""


_RESOLVERS: Final = {
    first: [("tag:yaml.org,2002:str", _CLOCK), *resolvers] if first.isdigit() else resolvers
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers = _RESOLVERS


class _QuickLoader(yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):  # type: ignore[misc]
    """Loader by libyaml, ten times as fast."""

    yaml_implicit_resolvers = _RESOLVERS


def parse_yaml(text: str, where: str) -> Any:
    """Plain values of a settings file.

    Args:
        where: names the file in the message.

    Raises:
        PaveTwinError: a key is given twice.
        yaml.YAMLError: it is not valid YAML.
        ValueError: a text looks like a date and is none.
    """
    try:
        return _parsed(_QuickLoader(text), where)
    except yaml.YAMLError:
        return _parsed(_Loader(text), where)  # its messages are better


def _parsed(loader: Any, where: str) -> Any:
    try:
        root = loader.get_single_node()
        if root is None:
            return None
        _check_keys(root, where)
        return loader.construct_document(root)
    finally:
        loader.dispose()


def _check_keys(root: yaml.Node, where: str) -> None:
    """Refuse a key that is given twice: PyYAML silently takes the last one."""
    waiting, seen = [root], set[int]()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            waiting += reversed(node.value)
        if not isinstance(node, yaml.MappingNode):
            continue
        waiting += [value for _, value in reversed(node.value)]
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
                continue
            line, name = key.start_mark.line + 1, (key.tag, key.value)
            if name in lines:
                first = f", first in line {lines[name]}" if lines[name] != line else ""
                raise PaveTwinError(f"{where}, line {line}: '{key.value}' is given twice{first}.")
            lines[name] = line


def line_of(text: str, place: Sequence[object]) -> int:
    """The line, from 1, of a place in a settings file.

    Args:
        text: valid YAML.
        place: keys and numbers of entries, from the outermost; a missing entry gets the line of its section.
    """
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    line = node.start_mark.line + 1 if node is not None else 1
    for step in place:
        if isinstance(node, yaml.MappingNode):
            found = next(((key, value) for key, value in node.value if key.value == str(step)), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
            found = (node.value[step], node.value[step])
        else:
            found = None
        if found is None:
            break
        line, node = found[0].start_mark.line + 1, found[1]
    return line


def why_unread(error: OSError | UnicodeDecodeError | yaml.YAMLError | ValueError) -> str:
    """The reason why a settings file could not be read, without a full stop."""
    if isinstance(error, OSError):
        return (error.strerror or str(error)).lower()
    if isinstance(error, UnicodeDecodeError):
        return f"it is not text in UTF-8 (byte {error.start})"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark, problem = error.problem_mark, error.problem or "it is not valid YAML"
        what = "a tab, where YAML takes spaces" if "'\\t'" in problem else problem
        begun, opened = _BEGUN.get(error.context or ""), error.context_mark
        where = f", in {begun} in line {opened.line + 1}" if begun and opened and opened.line < mark.line else ""
        return f"line {mark.line + 1}, column {mark.column + 1}: {what}{where}"
    return " ".join(str(error).split())

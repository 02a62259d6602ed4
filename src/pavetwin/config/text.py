"""Settings files as text: YAML in which no key is given twice and 10:30 is a time, not a number."""

import re
from collections.abc import Sequence
from typing import Any, Final

import yaml

from pavetwin.errors import PaveTwinError

_MERGE: Final = "tag:yaml.org,2002:merge"
"""Of `<<`: what it brings may be given again, and so may it."""


_CLOCK: Final = re.compile(r"^[0-9]+(:[0-5]?[0-9])+(\.[0-9]*)?$")
"""YAML 1.1 reads 10:30 as 630, a number of base 60; YAML 1.2 has no such numbers."""

_BEGUN: Final = {
    "while parsing a flow mapping": "the braces that open",
    "while parsing a flow sequence": "the brackets that open",
    "while scanning a quoted scalar": "the quoted text that begins",
}
"""What may lack its end, by the words of PyYAML: the mistake is then told where it was noticed, lines further on."""


class _Loader(yaml.SafeLoader):
    """PyYAML takes the last of two equal keys, and tells nobody."""

    yaml_implicit_resolvers = {  # noqa: RUF012, PyYAML declares it
        first: [("tag:yaml.org,2002:str", _CLOCK), *resolvers] if first.isdigit() else resolvers
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str, where: str) -> None:
        super().__init__(text)
        self._where = where

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
                continue
            line, name = key.start_mark.line + 1, (key.tag, key.value)
            if name in lines:
                first = f", first in line {lines[name]}" if lines[name] != line else ""
                raise PaveTwinError(f"{self._where}, line {line}: '{key.value}' is given twice{first}.")
            lines[name] = line
        return node


def parse_yaml(text: str, where: str) -> Any:
    """What a settings file says, in plain values.

    Args:
        where: names the file in the message.

    Raises:
        PaveTwinError: a key is given twice.
        yaml.YAMLError: it is not valid YAML.
        ValueError: something looks like a date and is none.
    """
    loader = _Loader(text, where)
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()


def line_of(text: str, place: Sequence[object]) -> int:
    """The line, from 1, in which a settings file says something.

    Args:
        text: valid YAML.
        place: keys and numbers of entries, from the outermost; what the file does not hold is where it would be.
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
    """Why a settings file could not be read, in plain words without a full stop."""
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

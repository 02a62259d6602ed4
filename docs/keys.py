"""Markdown tables of the keys of configuration classes: `python docs/keys.py pavetwin.defects.population.Population`.

Classes of data files give key, values, default and meaning; settings give the values of their presets instead.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Final

from pydantic import BaseModel

NAMES: Final = {"classes": "CLASS", "sizes": "PARAMETER", "near": "CLASS"}
"""Placeholders for the names in tables whose values are sections."""

HEAVIEST: Final = 1e6
"""Largest weight."""

PRESETS: Final = ("default", "paper")

Row = tuple[str, str, str, str]
"""Key, values, default, meaning."""


def rows(name: str) -> Iterator[Row]:
    """Rows of a class, given by its full name."""
    module, _, attribute = name.rpartition(".")
    schema = getattr(import_module(module), attribute).model_json_schema()
    yield from _rows(schema, schema["$defs"], "")


def table(name: str) -> str:
    """Markdown table of a class; of the presets' values for the settings of a mission."""
    found = list(rows(name))
    if name.endswith(".MissionSettings"):
        head: tuple[str, ...] = ("setting", *(f"`{preset}`" for preset in PRESETS), "meaning")
        lines = [head, *_with_presets(found)]
    else:
        lines = [("key", "values", "default", "meaning"), *((f"`{key}`", *rest) for key, *rest in found)]
    lines.insert(1, ("---",) * len(lines[0]))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _with_presets(found: list[Row]) -> Iterator[tuple[str, ...]]:
    load_settings = import_module("pavetwin.config").load_settings
    values = [load_settings(preset).model_dump(mode="json") for preset in PRESETS]
    for key, kind, _, meaning in found:
        if kind != "section":
            first, *others = (_value(each, key) for each in values)
            yield f"`{key}`", first, *("" if other == first else other for other in others), meaning


def _value(values: Mapping[str, Any], key: str) -> str:
    found: Any = values
    for name in key.split("."):
        found = found[name]
    shown = re.sub(r'"|\.0+\b', "", json.dumps(round(found, 4) if isinstance(found, float) else found))
    return f"`{shown}`"


def _rows(schema: Mapping[str, Any], others: Mapping[str, Any], prefix: str) -> Iterator[Row]:
    for name, entry in schema["properties"].items():
        key, inner = f"{prefix}{name}", _resolved(entry, others)
        meaning = " ".join(entry.get("description", inner.get("description", "")).split())
        default = "required" if name in schema.get("required", ()) else _shown(entry.get("default", ""))
        inside = inner.get("additionalProperties")
        named = _resolved(inside, others) if isinstance(inside, Mapping) else {}
        if "properties" in named:
            yield key, "by name", default, meaning
            yield from _rows(named, others, f"{key}.{NAMES[name]}.")
        elif "properties" in inner and "within" not in inner:
            yield key, "section", default if default in ("required", "none") else "", meaning
            yield from _rows(inner, others, f"{key}.")
        else:
            yield key, _values(inner, others), default, meaning


def _resolved(entry: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """An entry without references; the non-null choice of an optional value."""
    entry = dict(entry)
    for options in (entry.pop("anyOf", None), entry.pop("allOf", None)):
        if options:
            entry |= next(each for each in options if each.get("type") != "null")
    if reference := entry.pop("$ref", None):
        entry = {**others[reference.rpartition("/")[2]], **entry}
        return _resolved(entry, others) if "$ref" in entry or "anyOf" in entry else entry
    return entry


def _values(entry: Mapping[str, Any], others: Mapping[str, Any]) -> str:
    if "within" in entry:
        return f"`least`, `most` in {_span(*entry['within'])}"
    if "enum" in entry:
        return ", ".join(f"`{each}`" for each in entry["enum"])
    match entry.get("type"):
        case "boolean":
            return "`true`, `false`"
        case "number" if (entry.get("minimum"), entry.get("maximum")) == (0, HEAVIEST):
            return "weights"
        case "number" | "integer":
            low = f"above {entry['exclusiveMinimum']:g}" if "exclusiveMinimum" in entry else entry.get("minimum")
            bounds = _span(low, entry.get("maximum"))
            return f"{bounds}, whole" if entry["type"] == "integer" else bounds
        case "array" if "prefixItems" in entry:
            return f"[{', '.join(_values(_resolved(each, others), others) for each in entry['prefixItems'])}]"
        case "array":
            return f"list of {_values(_resolved(entry['items'], others), others)}"
        case "object":
            keys = entry.get("propertyNames", {})
            names = _values(_resolved(keys, others), others) if keys else "names"
            inside = entry.get("additionalProperties")
            return f"{names}: {_values(_resolved(inside, others), others)}" if isinstance(inside, Mapping) else names
        case _:
            return "text"


def _span(low: Any, high: Any) -> str:
    shown = [each if isinstance(each, str) else _shown(each) for each in (low, high) if each is not None]
    return " … ".join(shown) if len(shown) == 2 else shown[0] if shown else "number"


def _shown(value: Any) -> str:
    match value:
        case None:
            return "none"
        case bool():
            return f"`{json.dumps(value)}`"
        case float() | int():
            return f"{value:g}"
        case "":
            return ""
        case str():
            return f"`{value}`"
        case list():
            return f"[{', '.join(map(_shown, value))}]"
        case _:
            return ", ".join(f"`{key}`: {_shown(each)}" for key, each in value.items())


if __name__ == "__main__":
    # Set before any class is made: schemas then hold the docstrings of fields.
    BaseModel.model_config["use_attribute_docstrings"] = True
    print("\n\n".join(map(table, sys.argv[1:])))

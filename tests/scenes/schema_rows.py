"""What a schema says about its keys, as the tables of `docs/reference/data-files.md` have it."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from pavetwin.config.base import Settings

NAMES: Final = {"classes": "CLASS", "sizes": "PARAMETER", "near": "CLASS"}
"""What stands for the names in tables whose values are sections."""

HEAVIEST: Final = 1e6
"""The largest weight."""


def schema_rows(model: type[Settings]) -> dict[str, tuple[str, str]]:
    """Values that are taken, and what holds unless one is given, by key."""
    whole = model.model_json_schema()
    return dict(_rows(whole, whole["$defs"], ""))


def _rows(schema: Mapping[str, Any], others: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, tuple[str, str]]]:
    for name, entry in schema["properties"].items():
        key, inner = f"{prefix}{name}", _resolved(entry, others)
        needed = "must be given" if name in schema.get("required", ()) else ""
        default = needed or (_shown(entry["default"]) if "default" in entry else "")
        inside = inner.get("additionalProperties")
        named = _resolved(inside, others) if isinstance(inside, Mapping) else {}
        if "properties" in named:
            yield key, ("by name", default)
            yield from _rows(named, others, f"{key}.{NAMES[name]}.")
        elif "properties" in inner and "within" not in inner:
            optional = "default" in entry and entry["default"] is None
            yield key, ("section", "none" if optional else needed)
            yield from _rows(inner, others, f"{key}.")
        else:
            yield key, (_values(inner, others), default)


def _resolved(entry: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Without references, and what is not null of an optional value."""
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
        return f"`least`, `most` within {_span(*entry['within'])}"
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
            return f"{names}: {_values(_resolved(entry['additionalProperties'], others), others)}"
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
        case str():
            return f"`{value}`"
        case list():
            return f"[{', '.join(map(_shown, value))}]"
        case _:
            return ", ".join(f"`{key}`: {_shown(each)}" for key, each in value.items())

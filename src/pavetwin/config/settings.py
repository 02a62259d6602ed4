"""Typed configuration: frozen, unknown keys refused with the nearest known one, overridden by `key=value`."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from yaml import YAMLError

from pavetwin.config.text import line_of, parse_yaml
from pavetwin.errors import PaveTwinError, nearest_name


def _whole(paths: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(str(Path(path).absolute()) for path in paths)


PluginFiles = Annotated[tuple[str, ...], AfterValidator(_whole)]
"""Python files that register a user's own things (`pavetwin.plugins`); made absolute."""


_OWN_FILE: Final = re.compile(r"(?P<path>.+\.(py|ya?ml))(?P<name>:[^:/\\]*)?")


def _file_absolute(name: str) -> str:
    found = _OWN_FILE.fullmatch(name)
    return f"{Path(found['path']).absolute()}{found['name'] or ''}" if found else name


NameOrFile = Annotated[str, AfterValidator(_file_absolute)]
"""A registered name, or a file of the user's own (`cameras.yaml:name`, `sensors.py:ClassName`), made absolute."""


ASKED: Final = "?"
"""A value that asks for the choices; YAML would read a mapping."""

ALIASES: Final[Mapping[str, str]] = {
    "tau_o": "visibility.threshold",
    "recall": "sensing.recall",
    "d_max": "policy.max_displacement_m",
    "wait_s": "policy.wait_s",
    "max_wait_s": "policy.max_wait_s",
    "wind_mps": "conditions.wind_mps",
}
"""Short names in the sweep of a study, after the paper's notation; other settings take their full name."""

MEANT: Final[Mapping[str, str]] = {
    **dict.fromkeys(("battery", "battery_wh", "power"), "energy"),
    **dict.fromkeys(("drone", "uas"), "aircraft"),
    **dict.fromkeys(("height", "height_m", "altitude"), "altitude_m"),
    **ALIASES,
    "wind": "conditions",
}
"""Likely wrong names, each with the intended one."""


_PARAMETER: Final = re.compile(r"^`\w+`: ")


def _shown(key: object) -> str:
    """A key, or the number of an entry, from 1."""
    return str(key + 1) if isinstance(key, int) else str(key)


class PlacedValueError(ValueError):
    """Error of a validator of a whole section about a part of it."""

    def __init__(self, place: tuple[object, ...], words: str, *, named: bool = True) -> None:
        """Args:
        place: keys and indices of entries, from the section on.
        words: the message, without a full stop and without a leading parameter, which the place shows.
        named: False if the words name the last of the keys already.
        """
        super().__init__(_PARAMETER.sub("", words))
        self.place = place
        self.shown = tuple(map(_shown, place if named else place[:-1]))


class Settings(BaseModel):
    """Base class of all configuration."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, values: Any) -> Any:
        if isinstance(values, Mapping):
            for key in values:
                if key not in cls.model_fields:
                    known = ", ".join(cls.model_fields)
                    meant = MEANT.get(str(key), "")
                    named = f" (did you mean '{meant}'?)" if meant.partition(".")[0] in cls.model_fields else ""
                    near = named or nearest_name(str(key), cls.model_fields)
                    words = f"unknown key '{key}'{near or f'; known are {known}'}"
                    raise PlacedValueError((key,), words, named=False)
        return values

    @classmethod
    def parse(cls, values: Mapping[str, Any], where: str, text: str | None = None) -> Self:
        """Build from plain values.

        Args:
            where: the source, for messages; empty if the keys are parameters of the caller.
            text: text of the source file; messages then show the line.

        Raises:
            PaveTwinError: a key is unknown or a value does not fit.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            if not where:
                raise PaveTwinError(re.sub(r"^(\w+):", r"`\1`:", f"{describe(error)}.")) from error
            line = f", line {line_of(text, _place(error))}" if text is not None else ""
            raise PaveTwinError(f"{where}{line}: {describe(error)}.") from error


def _place(error: ValidationError) -> tuple[object, ...]:
    """Place of the first error, from the outermost key."""
    raised = _raised(error)
    return (*error.errors()[0]["loc"], *(raised.place if raised is not None else ()))


def _raised(error: ValidationError) -> PlacedValueError | None:
    raised = error.errors()[0].get("ctx", {}).get("error")
    return raised if isinstance(raised, PlacedValueError) else None


_BY_NAME: Final = ("dict_type", "mapping_type", "model_type")
_LISTS: Final = ("list_type", "tuple_type", "set_type", "frozen_set_type")
_ONE_VALUE: Final = ("string_type", "float_type", "int_type", "bool_type")
"""Types of validation errors: a single value in place of values by name, and the reverse."""


def describe(error: ValidationError) -> str:
    """The first error of a validation, as `key: message`, without a full stop."""
    first = error.errors()[0]
    raised = _raised(error)
    parts = [_shown(part) for part in first["loc"] if part != "[key]"]
    place = ".".join((*parts, *(raised.shown if raised is not None else ())))
    message = complaint(error)
    given = first["input"]
    if first["type"] in _BY_NAME and place:
        message = f"it has values by name; give {place}.NAME"
    elif first["type"] in _ONE_VALUE and isinstance(given, Mapping) and given:
        message = f"it is one value and has no '{next(iter(given))}'"
    shown = f" (got {given!r})" if isinstance(given, str | int | float | bool) else ""
    return f"{place}: {message}{shown}" if place else message


def complaint(error: ValidationError) -> str:
    """The first message of a validation error, without its place and a full stop."""
    first = error.errors()[0]
    if first["type"] in _LISTS:
        return "it must be a list"
    if first["type"] == "too_long":
        return f"give at most {first['ctx']['max_length']}, not {first['ctx']['actual_length']}"
    if first["type"] == "too_short":
        least = first["ctx"]["min_length"]
        return f"give at least {'one' if least == 1 else least}"
    if first["type"] == "string_too_short":
        return "it must not be empty"
    if first["type"] == "missing":
        return "it must be given"
    return first["msg"].removeprefix("Value error, ").replace("Input should be", "it must be").removesuffix(".")


def with_overrides(values: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """`values` with each `section.key=value` laid over it; the value is read as YAML.

    Raises:
        PaveTwinError: an override is not of the form key=value.
    """
    merged: dict[str, Any] = dict(values)
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals or not key.strip():
            raise PaveTwinError(f"`overrides` {override}: expected key=value, for example policy.max_wait_s=60.")
        try:
            value = text if text == ASKED else parse_yaml(text, where=f"`overrides` {override}")
        except (YAMLError, ValueError):  # a ValueError comes from what looks like a date and is none
            value = text
        layer = merged
        *sections, leaf = key.strip().split(".")
        for section in sections:
            inner = layer.get(section)
            layer[section] = dict(inner) if isinstance(inner, Mapping) else {}
            layer = layer[section]
        layer[leaf] = value
    return merged


def overlay(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """`above` laid over `below`, section by section."""
    merged = dict(below)
    for key, value in above.items():
        inner = merged.get(key)
        merged[key] = overlay(inner, value) if isinstance(inner, Mapping) and isinstance(value, Mapping) else value
    return merged


def _no_switch(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError("it must be a number")
    return value


NUMBER: Final = BeforeValidator(_no_switch)
"""Follows the bounds of a number, so that its schema keeps them."""

Number = Annotated[float, NUMBER]
Positive = Annotated[float, Field(gt=0), NUMBER]
NonNegative = Annotated[float, Field(ge=0), NUMBER]
Share = Annotated[float, Field(ge=0, le=1), NUMBER]

Weight = Annotated[float, Field(ge=0, le=1e6), NUMBER]
"""A relative frequency."""


def _some(weights: Mapping[Any, float]) -> Mapping[Any, float]:
    if not sum(weights.values()) > 0:
        raise ValueError("the weights sum to 0")
    return weights


SOME: Final = AfterValidator(_some)
"""Validator of a table of weights: at least one is above 0."""

Title = Annotated[str, Field(min_length=1)]

Weights = Annotated[Mapping[str, Weight], Field(min_length=1), SOME]
"""Names with their relative frequencies."""

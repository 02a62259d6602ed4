"""Every value of every data file that ships (looks, pavements, marks, marking standards, damage populations), changed
in every way that is a mistake: each is refused in one line with file, line and key, or stands here as legal."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from pavetwin.config.base import Settings
from pavetwin.config.named import checked, names_in
from pavetwin.defects import DEFECT_CLASSES, DefectOptions, place
from pavetwin.defects.population import Population, population
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.looks.mark import Mark, mark
from pavetwin.scene.ground.looks.marking_standard import MarkingStandard, marking_standard
from pavetwin.scene.ground.looks.pavement import PACKAGE, Pavement, pavement
from pavetwin.scene.ground.looks.street_look import StreetLook, check_parts, street_look
from pavetwin.scene.ground.markings.standard import paint
from scenes import built
from scenes.schema_rows import schema_rows

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Kind:
    """One kind of data file."""

    package: str
    folder: str
    schema: type[Settings]
    check: Callable[[Any], None]
    read: Callable[[str], Settings]

    def values(self, name: str) -> dict[str, Any]:
        text = (files(self.package) / self.folder / f"{name}.yaml").read_text(encoding="utf-8")
        return dict(yaml.safe_load(text))


def _all(data: Settings) -> None:
    assert isinstance(data, Settings)


KINDS: Final = {
    "population": Kind("pavetwin.defects", "populations", Population, Population.check, population),
    "look": Kind(PACKAGE, "streets", StreetLook, partial(check_parts, name="mine.yaml"), street_look),
    "pavement": Kind(PACKAGE, "pavements", Pavement, _all, pavement),
    "mark": Kind(PACKAGE, "marks", Mark, _all, mark),
    "standard": Kind(PACKAGE, "standards", MarkingStandard, _all, marking_standard),
}

FILES: Final = [(kind, name) for kind, each in KINDS.items() for name in names_in(each.package, each.folder)]


def places(value: Any, here: Key = ()) -> Iterator[tuple[Key, Any]]:
    """The keys of a file with their values; of long lists the first three entries."""
    if here:
        yield here, value
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from places(inner, (*here, key))
    if isinstance(value, list):
        for index, inner in enumerate(value[:3]):
            yield from places(inner, (*here, index))


def with_value(values: Any, key: Key, value: Any) -> Any:
    """A copy in which one value is another one."""
    if not key:
        return value
    changed = dict(values) if isinstance(values, Mapping) else list(values)
    changed[key[0]] = with_value(values[key[0]], key[1:], value)
    return changed


def mistakes(value: Any) -> Iterator[tuple[str, Any]]:
    """Values that are hardly meant in place of one."""
    yield "text", "quite a lot"
    yield "list", [value]
    yield "table", {"some": value}
    yield "none", None
    if isinstance(value, bool):
        yield "number", 3
    elif isinstance(value, int | float):
        yield "switch", True
        yield "nan", math.nan
        yield "infinite", math.inf
        yield "huge", 1e9
        yield "large", 1000.0 * value if value else 1e4
        yield "negative", -abs(value) or -1.0
        yield "zero", 0
    elif isinstance(value, str):
        yield "empty", ""
        yield "number", 3
        yield "misspelt", f"{value[:-1]}{value[-1]}q"
    elif isinstance(value, Mapping):
        yield "empty", {}
        yield (
            "misspelt key",
            {f"{key}q" if number == 0 else key: each for number, (key, each) in enumerate(value.items())},
        )
        yield "unknown key", {**value, "quite_unknown": 1}
        if all(isinstance(each, int | float) for each in value.values()):
            yield "all zero", dict.fromkeys(value, 0)
        if {"least", "most"} <= value.keys():
            yield "swapped", {**value, "least": value["most"], "most": value["least"]}
            yield "least above most", {**value, "least": 2 * abs(value["most"]) + 1}
        if "median" in value:
            yield "median below least", {**value, "median": value["least"] / 2}
            yield "median above most", {**value, "median": value["most"] * 2}
            for what, factor in (("in thousandths", 1e-3), ("in thousands", 1e3)):
                yield what, {**value, **{name: value[name] * factor for name in ("median", "least", "most")}}
    elif isinstance(value, list):
        yield "empty", []
        yield "one more", [*value, value[-1] if value else 1]
        yield "reversed", value[::-1]


LEGAL: Final[Mapping[str, Mapping[str, tuple[str, ...]]]] = {
    "*": {
        "title": ("text", "misspelt"),  # any words
        "*_share": ("zero",),  # of nothing
        "share": ("zero",),
        "*.share": ("zero",),
    },
    "population": {
        "density": ("all zero",),  # no damage
        "density.*": ("zero",),
        "classes": ("empty",),  # all classes with their own sizes
        "*.sizes": ("empty",),  # the class's own
        "*.positions": ("empty",),
        "*.near": ("empty",),
        "*.within": ("empty", "all zero"),
        "*.context": ("empty", "none", "all zero"),
        "*.weight": ("zero", "large"),  # weights are relative
        "*.growth": ("zero",),
        "*.sigma": ("zero",),
        "*.positions.*": ("zero",),
        "*.within.*": ("zero",),
        "*.context.*": ("zero",),
        "*.times": ("empty", "one more", "reversed"),  # what is named twice counts twice
        "*.sizes.wear": ("in thousandths",),  # new networks
        "*.on_slabs": ("none",),
        "*.across_m": ("none",),
    },
    "look": {
        **dict.fromkeys(("main.*", "other.*", "*.pavements.*", "covers.*", "grates.*"), ("zero", "large")),
        **dict.fromkeys(("*.kinds.*", "bridge_joints.*", "repairs.*.*", "sidewalks.pavings.*"), ("zero", "large")),
        "sidewalks.red": ("zero",),
        **dict.fromkeys(("repairs", "sidewalks", "former_markings", "overhead"), ("empty",)),  # the defaults
        **dict.fromkeys(("dirt", "marks"), ("empty", "all zero")),
        **dict.fromkeys(("dirt.*", "marks.*", "litter_per_100_m", "paint_wear"), ("zero",)),
        **dict.fromkeys(("repairs.connections", "repairs.renewed", "repairs.cold_patches_per_100_m"), ("zero",)),
        **dict.fromkeys(("overhead.wired", "overhead.connections", "overhead.bare_trees"), ("zero",)),
    },
    "pavement": {
        **dict.fromkeys(("age", "grain", "wheel_paths"), ("all zero",)),
        "repairs": ("empty", "all zero"),
        "tint": ("empty",),
        **dict.fromkeys(("*.spread", "streaks", "blotches", "oil", "repairs.*"), ("zero",)),
        **dict.fromkeys(("age.least", "grain.least"), ("zero",)),
        "wheel_paths.*": ("zero", "negative"),  # darker
        "slabs": ("none",),  # concrete without joints
        "slabs.expansion_every": ("none",),
    },
    "mark": {
        "strokes": ("reversed", "one more"),
        "strokes.*": ("reversed", "zero", "negative", "large"),  # any place within 40 m
        "colours.*": ("large",),
        "colours.?*": ("zero",),
        "wear": ("all zero",),  # new paint
        "wear.least": ("zero",),
    },
    "standard": {
        **dict.fromkeys(("signalled.*", "unsignalled.*"), ("zero", "large")),
        **dict.fromkeys(("hatching", "box", "rumble", "crossing_dash_m", "left_edge_colour"), ("none",)),
        **dict.fromkeys(("*dash_m", "*stripe_m", "*bar_m"), ("reversed",)),  # painted and free
        "areas": ("empty", "one more", "reversed"),
        "areas.*": ("one more", "reversed", "zero", "negative"),  # any place on Earth
    },
}
"""What may be given all the same, by kind of file and key: with it, the file says something that somebody may mean."""


def shown(key: Key) -> str:
    """As messages have it: entries count from 1."""
    return ".".join(str(part + 1) if isinstance(part, int) else part for part in key)


def is_legal(kind: str, key: Key, what: str) -> bool:
    rules = [*LEGAL["*"].items(), *LEGAL[kind].items()]
    return any(what in allowed and fnmatch(shown(key), pattern) for pattern, allowed in rules)


def refusal(kind: Kind, values: Any) -> str | None:
    """What is told about a file; None where it is taken."""
    try:
        checked(kind.schema, values, text="", where="mine.yaml", check=kind.check)
    except PaveTwinError as error:
        return str(error)
    return None


@pytest.mark.parametrize(("kind", "name"), FILES, ids=lambda each: each)
def test_every_mistake_in_a_value_is_refused_in_one_line_with_its_key(kind: str, name: str) -> None:
    values = KINDS[kind].values(name)
    assert refusal(KINDS[kind], values) is None
    wrong = []
    for key, value in places(values):
        for what, other in mistakes(value):
            told = refusal(KINDS[kind], with_value(values, key, other))
            if told is None:
                if not is_legal(kind, key, what):
                    wrong.append(f"{shown(key)}, {what}: taken")
            elif "\n" in told or not any(str(part) in told for part in key if isinstance(part, str)):
                wrong.append(f"{shown(key)}, {what}: {told}")
            elif any(words in told for words in ("tuple", "Tuple", "after validation", "`: ")):
                wrong.append(f"{shown(key)}, {what}, in words of the program: {told}")
    assert wrong == []


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_called_legal_is_taken(kind: str) -> None:
    """Each rule of `LEGAL` stands for a value that ships, and is not wider than the schema."""
    used: dict[str, set[str]] = {pattern: set() for pattern in LEGAL[kind]}
    for each, name in FILES:
        if each == kind:
            values = KINDS[kind].values(name)
            for key, value in places(values):
                for pattern in (pattern for pattern in used if fnmatch(shown(key), pattern)):
                    taken = (
                        what
                        for what, other in mistakes(value)
                        if what in LEGAL[kind][pattern] and refusal(KINDS[kind], with_value(values, key, other)) is None
                    )
                    used[pattern].update(taken)
    assert {
        pattern: set(LEGAL[kind][pattern]) - whats
        for pattern, whats in used.items()
        if set(LEGAL[kind][pattern]) - whats
    } == {}


def lines(values: Any, here: Key = (), depth: int = 0) -> Iterator[tuple[str, Key]]:
    """A file as YAML with one key or entry a line, each with its keys."""
    entries = values.items() if isinstance(values, Mapping) else enumerate(values)
    for key, value in entries:
        start = "  " * depth + (f"{key}:" if isinstance(values, Mapping) else "-")
        if isinstance(value, Mapping) or (isinstance(value, list) and any(isinstance(each, list) for each in value)):
            yield start, (*here, key)
            yield from lines(value, (*here, key), depth + 1)
        else:
            yield (
                f"{start} {yaml.safe_dump(value, default_flow_style=True, width=math.inf).splitlines()[0]}",
                (*here, key),
            )


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("population", "survey"),
        ("look", "varied"),
        ("pavement", "concrete"),
        ("mark", "speed_30"),
        ("standard", "united_kingdom"),
    ],
)
def test_a_mistake_is_told_with_file_line_and_key(tmp_path: Path, kind: str, name: str) -> None:
    values = KINDS[kind].values(name)
    values = {key: value for key, value in values.items() if key != "areas"}
    numbered = list(enumerate(lines(values), start=1))
    for number, (_, key) in numbered[:: 1 + len(numbered) // 10]:
        told = list(lines(with_value(values, key, [["nothing that fits"]])))
        path = tmp_path / f"{number}.yaml"
        path.write_text("\n".join(line for line, _ in told) + "\n", encoding="utf-8")
        with pytest.raises(PaveTwinError) as caught:
            KINDS[kind].read(str(path))
        found = re.fullmatch(rf".* '{re.escape(str(path))}', line (\d+): ([\w.]+): .*\.", str(caught.value))
        assert found is not None, str(caught.value)
        assert int(found[1]) in (number, number + 1, number + 2), str(caught.value)
        assert found[2].startswith(shown(key)), str(caught.value)


PAGE: Final = Path(__file__).resolve().parent.parent / "docs" / "reference" / "data-files.md"

HEADINGS: Final = {
    "Damage population": Population,
    "Look": StreetLook,
    "Pavement": Pavement,
    "Mark": Mark,
    "Marking standard": MarkingStandard,
}


def chapter(heading: str) -> str:
    return PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


@pytest.mark.parametrize("heading", HEADINGS)
def test_the_reference_has_every_key_with_its_values_and_its_default(heading: str) -> None:
    rows = re.findall(r"^\| `([\w.]+)` \| (.*?) \| (.*?) \| \w.* \|$", chapter(heading), flags=re.MULTILINE)
    assert {key: (values.strip(), default.strip()) for key, values, default in rows} == schema_rows(HEADINGS[heading])


def test_sizes_reach_as_far_as_the_reference_says() -> None:
    rows = re.findall(r"^\| (`\w+`)? ?\| (`.*?) \| (\S+) … (\S+) \|$", chapter("Damage population"), flags=re.MULTILINE)
    told, kind = set(), ""
    for name, parameters, *limits in rows:
        kind = name.strip("`") or kind
        for parameter in re.findall(r"`(\w+)`", parameters):
            told.add((kind, parameter))
            low, high = map(float, limits)
            take = partial(DEFECT_CLASSES.get(kind).parameters_from, where="here")
            for inside in (low, high):
                take(((parameter, inside),))
            beyond = 1.0 if "whole" in parameters else 0.01 * low or 0.01
            for outside in (low - beyond, high + beyond):
                with pytest.raises(PaveTwinError):
                    take(((parameter, outside),))
    schemas = {kind.name: kind.parameters for kind in DEFECT_CLASSES.values() if kind.ships}
    assert told == {(kind, name) for kind, schema in schemas.items() if schema for name in schema.model_fields}


def test_the_files_of_the_reference_are_taken_and_used(tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name, text in re.findall(r'^```yaml title="(.+?)"\n(.*?)^```', page, flags=re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert len(list(tmp_path.iterdir())) == len(HEADINGS)
    placed = place(built("cross").world.segments[:3], 1, DefectOptions(population=str(tmp_path / "our-damage.yaml")))
    assert "single_crack" in {defect.kind for defect in placed}
    plan = plan_ground(built("cross").world, 3, look=street_look(str(tmp_path / "our-town.yaml")))
    assert plan.standard.centre_colour == "yellow"
    assert "chip seal of our quarry" in {plan.pavement(each).title for each in plan.streets}
    assert (plan.paint.bar_looks[:, 0] == paint("yellow")).any()

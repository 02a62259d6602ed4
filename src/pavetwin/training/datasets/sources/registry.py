"""Sources of images: class rules, the source itself, its registry, and mapping files for sources of the user's own."""

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, Field, field_validator
from yaml import YAMLError

from pavetwin.config.settings import Settings
from pavetwin.config.text import parse_yaml, why_unread
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.labels.common_form import class_names
from pavetwin.registry import Registry
from pavetwin.training.datasets.layouts import AnyLayout
from pavetwin.training.datasets.layouts.layout import LabelLayout

DROP: Final = "drop"
"""Objects of the class stay background."""
IGNORE: Final = "ignore"
"""Objects of the class are neither objects nor background: damage of a class that is not learned, or ambiguous."""
DISCARD: Final = "discard image"
"""Images with an object of the class are left out."""

OUTCOMES: Final = (DROP, IGNORE, DISCARD)


@lru_cache(maxsize=4096)
def plain(label: str) -> str:
    """A class's name as it is compared: `Longitudinal_Crack` and `longitudinal crack` are one."""
    return re.sub(r"[\s_-]+", " ", label).strip().casefold()


def _checked(table: Mapping[str, str]) -> Mapping[str, str]:
    known, spelled = (*class_names(), *OUTCOMES), dict[str, str]()
    for label, outcome in table.items():
        if outcome not in known:
            raise ValueError(
                f"'{label}' becomes '{outcome}'{nearest_name(outcome, known)}; it must be one of {', '.join(known)}"
            )
        other = spelled.setdefault(plain(label), label)
        if table[other] != outcome:
            raise ValueError(f"'{other}' and '{label}' are compared as one class, and become two")
    return table


ClassRules = Annotated[Mapping[str, str], AfterValidator(_checked)]
"""A class of the common form, or one of `OUTCOMES`, keyed by class of the source, compared as `plain`."""


def outcome(rules: Mapping[str, str], label: str) -> str | None:
    """Outcome of a class; None if no rule names it."""
    wanted = plain(label)
    return next((becomes for name, becomes in rules.items() if plain(name) == wanted), None)


def unknown_class(rules: Mapping[str, str], label: str) -> str:
    """The words about a class that no rule names, with the nearest."""
    return f"class '{label}' is not known{nearest_name(label, rules, compared=plain)}"


class DatasetSource(Settings):
    """A dataset: publisher, licence, layout of labels, and mapping of classes.

    A mapping file holds the same keys, `labels` with its `format` among them.
    """

    title: str = Field(default="", description="Its name, and who published it.")
    home: str | None = Field(
        default=None, description="Its page, from which it is downloaded; null where none was verified."
    )
    licence: str = Field(default="", description="As stated there.")
    labels: LabelLayout = Field(description="Layout of the label files.")
    classes: ClassRules = Field(
        min_length=1, description="Class of the source → class here, or drop, ignore, discard image."
    )
    group: str | None = Field(
        default=None,
        description="A pattern (Python's `re`) that finds the scene in a picture's path: its first group, or all.",
    )
    gsd_mm: float | None = Field(
        default=None, gt=0, le=1000, description="Millimetres a pixel covers, where all images have one."
    )

    @field_validator("group")
    @classmethod
    def _is_pattern(cls, pattern: str | None) -> str | None:
        try:
            re.compile(pattern or "")
        except re.error as error:
            raise ValueError(f"is not a readable pattern ({error})") from error
        return pattern

    def group_of(self, original: str) -> str:
        """The scene that a picture's path names; the path itself where no pattern finds one."""
        found = re.search(self.group, original) if self.group is not None else None
        if found is None:
            return original
        return found[1] if found.re.groups else found[0]


class MappingFile(DatasetSource):
    """A source as a mapping file describes it."""

    labels: AnyLayout = Field(description="Layout of the label files.")


def _broken_rules(source: DatasetSource) -> list[str]:
    broken = []
    if not source.title or not source.licence:
        broken.append("a source needs a title and a licence.")
    if source.home is not None and not source.home.startswith("https://"):
        broken.append(f"its home '{source.home}' must begin with https://.")
    if set(source.classes.values()) <= set(OUTCOMES):
        broken.append("none of its classes becomes a class of the common form.")
    return broken


SOURCES: Final[Registry[DatasetSource]] = Registry(
    "dataset source",
    key="source",
    group="pavetwin.sources",
    home="pavetwin.training.datasets.sources",
    rules=_broken_rules,
)


def is_mapping_file(name: str) -> bool:
    """Return whether a source is named by a mapping file."""
    return name.lower().endswith((".yaml", ".yml"))


def source_name(name: str) -> str:
    """The name that images get of a known source, or of one in a mapping file (`mine.yaml`)."""
    return re.sub(r"[^A-Za-z0-9]+", "-", Path(name).stem).strip("-") or "own" if is_mapping_file(name) else name


def source_of(name: str) -> tuple[str, DatasetSource]:
    """A source by its name, or from a mapping file (`mine.yaml`); and the name that its images get.

    Raises:
        PaveTwinError: there is no such source; the message names the nearest. Or the mapping file cannot be read.
    """
    if not is_mapping_file(name):
        return name, SOURCES.get(name, instead=", or a mapping file (mine.yaml)")
    path = Path(name)
    try:
        text = path.read_text(encoding="utf-8")
        content = parse_yaml(text, where=f"the mapping file '{name}'")
    except (OSError, UnicodeDecodeError) as error:
        raise PaveTwinError(f"`source`: the mapping file '{name}' cannot be read.") from error
    except (YAMLError, ValueError) as error:
        raise PaveTwinError(f"`source`: the mapping file '{name}' is not valid YAML: {why_unread(error)}.") from error
    if not isinstance(content, dict):
        raise PaveTwinError(f"`source`: the mapping file '{name}' must hold keys such as labels and classes.")
    return source_name(name), MappingFile.parse(content, where=f"'{name}'", text=text)

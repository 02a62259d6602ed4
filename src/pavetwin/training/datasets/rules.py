"""What becomes of a source's classes: a class of the common form, or one of three other outcomes."""

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Final

from pydantic import AfterValidator

from pavetwin.errors import nearest_name
from pavetwin.training.datasets.annotated import class_names

DROP: Final = "drop"
"""What it shows stays background."""
IGNORE: Final = "ignore"
"""It is neither an object nor background: damage of a class that is not learned, or a thing that may count as one."""
DISCARD: Final = "discard image"
"""Images with one are left out."""

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
"""By class of the source, compared as `plain`: a class of the common form, or one of `OUTCOMES`."""


def outcome(rules: Mapping[str, str], label: str) -> str | None:
    """What becomes of a class; None where no rule names it."""
    wanted = plain(label)
    return next((becomes for name, becomes in rules.items() if plain(name) == wanted), None)


def unknown_class(rules: Mapping[str, str], label: str) -> str:
    """The words about a class that no rule names, with the nearest."""
    return f"class '{label}' is not known{nearest_name(label, rules, compared=plain)}"

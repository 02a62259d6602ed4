"""Named mixes of vehicles: which kinds are on the streets, and how common each is. One YAML file of `mixes` each."""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Final, Self

import yaml
from pydantic import Field, model_validator

from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS, VEHICLES, Kind

DEFAULT_MIX: Final = "europe"
"""The kinds and shares of `kinds.VEHICLES`."""

_FOLDER: Final = files("pavetwin.traffic") / "mixes"


class Mix(Settings):
    """A mix as its file holds it."""

    what: str
    """In a few words."""
    sources: tuple[str, ...]
    """Where shares are from."""
    ours: str
    """Which of them are assumptions of ours."""
    shares: Mapping[str, Annotated[float, Field(gt=0, le=1)]]
    """Kind → share of all vehicles; they sum to 1."""

    @model_validator(mode="after")
    def _of_known_kinds(self) -> Self:
        if unknown := [name for name in self.shares if name not in KINDS]:
            raise ValueError(f"unknown kind of vehicle '{unknown[0]}'")
        if abs(sum(self.shares.values()) - 1.0) > 1e-9:
            raise ValueError(f"the shares sum to {sum(self.shares.values()):g}, not to 1")
        return self

    @property
    def vehicles(self) -> tuple[tuple[Kind, float], ...]:
        """Kinds and their shares."""
        return tuple((KINDS[name], share) for name, share in self.shares.items())


def mix_names() -> list[str]:
    """The mixes that ship with the package, the default first."""
    names = (entry.name.removesuffix(".yaml") for entry in _FOLDER.iterdir() if entry.name.endswith(".yaml"))
    return sorted(names, key=lambda name: (name != DEFAULT_MIX, name))


@cache
def mix_named(name: str) -> Mix:
    """Raises:
    PaveTwinError: there is no such mix; the message gives the nearest name.
    """
    if name not in mix_names():
        raise PaveTwinError(no_such("mix of vehicles", name, mix_names(), key="`mix`"))
    text = (_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    return Mix.parse(yaml.safe_load(text), where=f"the mix '{name}'")


def kinds_of(name: str) -> Iterator[Kind]:
    """The kinds that SUMO must know for a mix: those of the default mix, people, and what else the mix has."""
    yield from VEHICLES
    yield from PEDESTRIANS
    yield from (kind for kind, _ in mix_named(name).vehicles if kind not in VEHICLES)

"""Recovery policies: the base class and the actions that a policy can answer with."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import hypot, isfinite
from types import MappingProxyType
from typing import Any, ClassVar

from pavetwin.config.mission import PolicySettings
from pavetwin.config.options import OptionValue, checked_options
from pavetwin.twin import Place, Snapshot


@dataclass(frozen=True, slots=True)
class GoOn:
    """Continue along the route."""


@dataclass(frozen=True, slots=True)
class Wait:
    """Brake to a stop, and look again `seconds` after the decision."""

    seconds: float

    def __post_init__(self) -> None:
        if not (isfinite(self.seconds) and self.seconds > 0):
            raise ValueError(f"Wait({self.seconds}): the seconds must be positive")


@dataclass(frozen=True, slots=True)
class Displace:
    """Brake, move aside without turning, stay for a capture, and come back to the route."""

    east_m: float
    north_m: float
    stay_s: float = 0.6

    def __post_init__(self) -> None:
        if not (isfinite(hypot(self.east_m, self.north_m)) and isfinite(self.stay_s) and self.stay_s >= 0):
            raise ValueError(f"{self}: displacement and stay must be finite and the stay not negative")

    @property
    def length_m(self) -> float:
        return hypot(self.east_m, self.north_m)


@dataclass(frozen=True, slots=True)
class Revisit:
    """Fly on now, and come back to `place` after this pass to stay over it."""

    place: Place
    stay_s: float = 5.0

    def __post_init__(self) -> None:
        if not (isfinite(hypot(*self.place)) and isfinite(self.stay_s) and self.stay_s > 0):
            raise ValueError(f"{self}: the place must be finite and the stay positive")


Action = GoOn | Wait | Displace | Revisit


class Pilot(StrEnum):
    """The crew that can carry out a policy with a real drone and an exported plan."""

    ANY = "anyone"
    """The plan suffices."""
    OBSERVER = "with an observer"
    """A second person watches the live image and calls out when the road is hidden."""
    NOBODY = "nobody by hand"
    """It takes a computer that knows the traffic around the drone."""
    UNKNOWN = "not stated"


class Policy(ABC):
    """Π: asked whenever o_{s*,t} < τ_o while inspecting. Decides from the snapshot alone."""

    name: str = ""
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({})
    """Its options with their defaults. A value in `policy.options` must have the type of the default; a whole number is
    accepted as a number."""
    reads: ClassVar[frozenset[str]] = frozenset(PolicySettings.model_fields) - {"options"}
    """The settings of the section `policy` that it reads, except `options`: a study that sweeps another one flies it
    once. Not inherited: a subclass that does not declare it may read any."""

    pilot: ClassVar[Pilot] = Pilot.UNKNOWN
    """The crew for a manual flight; like `by_hand` not inherited, since a subclass acts differently."""
    by_hand: ClassVar[str] = ""
    """How a pilot flies it manually, or why not, in one sentence; empty if not stated."""

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        for name in ("reads", "pilot", "by_hand"):
            if name not in vars(cls):
                setattr(cls, name, getattr(Policy, name))

    def __init__(self, settings: PolicySettings) -> None:
        """Raises:
        PaveTwinError: it has no such option, or a value is of another type.
        """
        self.settings = settings
        self.options: Mapping[str, OptionValue] = checked_options(
            settings.options,
            self.default_options,
            key="policy.options",
            owner=f"the policy '{self.name or type(self).__name__}'",
        )
        """The value of every option."""

    @abstractmethod
    def decide(self, snapshot: Snapshot) -> Action:
        """The action for a snapshot. It must depend on nothing but the snapshot and the settings."""

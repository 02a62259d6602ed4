"""What a recovery policy is, what it may answer, and where it is registered."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, isfinite

from pavetwin.config.mission import PolicySettings
from pavetwin.twin import Place, Snapshot


@dataclass(frozen=True, slots=True)
class GoOn:
    """Fly on along the route."""


@dataclass(frozen=True, slots=True)
class Wait:
    """Brake, stay where that ends, and look again `seconds` after the decision."""

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


class Policy(ABC):
    """Π: asked whenever o_{s*,t} < τ_o while inspecting. Decides from the snapshot alone."""

    name: str = ""

    def __init__(self, settings: PolicySettings) -> None:
        self.settings = settings

    @abstractmethod
    def decide(self, snapshot: Snapshot) -> Action:
        """What to do now. Must depend on nothing but the snapshot and the settings."""


_POLICIES: dict[str, type[Policy]] = {}


def policy(name: str) -> Callable[[type[Policy]], type[Policy]]:
    """Register a policy under `name`, which `--policy` then takes.

    A name may be taken once; the same class read again from its file takes its own name anew.
    """

    def register(kind: type[Policy]) -> type[Policy]:
        known = _POLICIES.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (kind.__module__, kind.__qualname__):
            raise ValueError(f"a policy '{name}' is registered already")
        kind.name = name
        _POLICIES[name] = kind
        return kind

    return register


def policy_names() -> list[str]:
    """The registered policies, in the order of registration."""
    return list(_POLICIES)


def registered(name: str) -> type[Policy] | None:
    """The policy of a name, if there is one."""
    return _POLICIES.get(name)

"""What a recovery policy is, what it may answer, and where it is registered."""

import importlib.util
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, isfinite
from pathlib import Path

from pavetwin.config.mission import PolicySettings
from pavetwin.errors import PaveTwinError, nearest_name
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
        if not isfinite(hypot(self.east_m, self.north_m)) or self.stay_s < 0:
            raise ValueError(f"{self}: the displacement must be finite and the stay not negative")

    @property
    def length_m(self) -> float:
        return hypot(self.east_m, self.north_m)


@dataclass(frozen=True, slots=True)
class Revisit:
    """Fly on now, and come back to `place` after this pass to stay over it."""

    place: Place
    stay_s: float = 5.0


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
    """Register a policy under `name`, which `--policy` then takes."""

    def register(kind: type[Policy]) -> type[Policy]:
        if name in _POLICIES:
            raise ValueError(f"a policy '{name}' is registered already")
        kind.name = name
        _POLICIES[name] = kind
        return kind

    return register


def policy_names() -> list[str]:
    """The registered policies, in the order of registration."""
    return list(_POLICIES)


def load_policy(name: str, settings: PolicySettings) -> Policy:
    """A registered policy by name, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: there is none, or its file does not give a policy.
    """
    path, colon, class_name = name.rpartition(":")
    if colon and path.endswith(".py"):
        return _from_file(Path(path), class_name)(settings)
    if name.endswith(".py"):
        raise PaveTwinError(f"--policy {name}: name the class too, as {name}:ClassName.")
    if name not in _POLICIES:
        near = nearest_name(name, _POLICIES) or f"; known are {', '.join(_POLICIES)}"
        raise PaveTwinError(f"No policy '{name}'{near}, or give your own as path/to/file.py:ClassName.")
    return _POLICIES[name](settings)


def _from_file(path: Path, class_name: str) -> type[Policy]:
    if not path.is_file():
        raise PaveTwinError(f"--policy: there is no file '{path}'.")
    module_name = f"pavetwin_user_policy_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise PaveTwinError(f"--policy: '{path}' cannot be read as Python.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PaveTwinError(f"--policy: '{path}' fails when read: {type(error).__name__}: {error}.") from error
    kind = getattr(module, class_name, None)
    if not (isinstance(kind, type) and issubclass(kind, Policy)):
        known = [key for key, value in vars(module).items() if isinstance(value, type) and issubclass(value, Policy)]
        raise PaveTwinError(
            f"--policy: '{path}' has no policy class '{class_name}'{nearest_name(class_name, known)}. "
            "It must be a subclass of pavetwin.policies.Policy."
        )
    kind.name = kind.name or class_name
    return kind

"""Policies by name, or from a user's own file."""

import importlib.util
import sys
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from pathlib import Path
from sysconfig import get_paths
from types import CodeType
from typing import Final

from pavetwin.config.mission import PolicySettings
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.policies.base import Policy, policy_names, registered
from pavetwin.policies.conformance import check_policy

_OWN: Final = "pavetwin_user_policy_"
"""How modules read from a user's policy file are called."""


def load_policy(name: str, settings: PolicySettings) -> Policy:
    """A registered policy by name, or a user's own as `path/to/file.py:ClassName`, once it has passed `check_policy`.

    Raises:
        PaveTwinError: there is none, its file does not give a policy, or the policy breaks a rule.
    """
    path, colon, class_name = name.rpartition(":")
    if colon and path.endswith(".py"):
        kind = _from_file(Path(path), class_name)
        if broken := check_policy(kind):
            more = f" (and {len(broken) - 1} more)" if len(broken) > 1 else ""
            raise PaveTwinError(f"--policy: '{name}' breaks a rule of policies: {broken[0]}{more}.")
        return kind(settings)
    if name.endswith(".py"):
        raise PaveTwinError(f"--policy {name}: name the class too, as {name}:ClassName.")
    known = registered(name)
    if known is None:
        near = nearest_name(name, policy_names()) or f"; known are {', '.join(policy_names())}"
        raise PaveTwinError(f"No policy '{name}'{near}, or give your own as path/to/file.py:ClassName.")
    return known(settings)


def helpers_of(path: Path) -> list[Path]:
    """The files beside or below a user's policy that this process has imported once it was loaded, sorted: what it
    does may depend on them. Installed packages are none of them, nor are other policies loaded from their file.
    """
    folder, installed = path.resolve().parent, [Path(place).resolve() for place in set(get_paths().values())]
    found = set()
    for name, module in list(sys.modules.items()):
        source = getattr(module, "__file__", None)
        if not source or name.partition(".")[0] in ("__main__", "pavetwin") or name.startswith(_OWN):
            continue
        file = Path(source).resolve()
        if folder in file.parents and not any(place in file.parents for place in installed):
            found.add(file)
    return sorted(found)


class _Uncached(SourceFileLoader):
    """Always compiles the source: leaves no `__pycache__` in the user's folder, and reads none that is stale."""

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - the signature of a loader
        return self.source_to_code(self.get_data(self.path), self.path)


def _from_file(path: Path, class_name: str) -> type[Policy]:
    if not path.is_file():
        raise PaveTwinError(f"--policy: there is no file '{path}'.")
    # Two files of the same name in different folders are two modules.
    module_name = f"{_OWN}{path.stem}_{sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    loader = _Uncached(module_name, str(path))
    spec = importlib.util.spec_from_file_location(module_name, path, loader=loader)
    if spec is None:
        raise PaveTwinError(f"--policy: '{path}' cannot be read as Python.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[module_name]
        told = " ".join(str(error).split())
        raise PaveTwinError(f"--policy: '{path}' fails when read: {type(error).__name__}: {told}.") from error
    kind = getattr(module, class_name, None)
    if not (isinstance(kind, type) and issubclass(kind, Policy)):
        own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module_name]
        policies = [key for key in own if isinstance(vars(module)[key], type) and issubclass(vars(module)[key], Policy)]
        raise PaveTwinError(
            f"--policy: '{path}' has no policy class '{class_name}'{nearest_name(class_name, policies)}. "
            "It must be a subclass of pavetwin.policies.Policy."
        )
    kind.name = vars(kind).get("name") or class_name  # not its base's: a changed hover is not hover
    return kind

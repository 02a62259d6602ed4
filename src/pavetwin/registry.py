"""Things that go by a name, each in a registry of its kind: policies, sensors, patterns, cameras and the like.

A new one is one file and one line: a decorator (`@policy("name")`) or a call (`CAMERAS.add("name", camera)`). Those
that ship with the package are in no list: a registry imports every module of its `home` when it is first asked, so that
a new file is all there is to add. A user's own come from plugin files (`pavetwin.plugins`) or from installed packages,
whose entry points of the registry's group are loaded when names are listed or one is not known.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, Generic, NamedTuple, TypeVar

from pavetwin.errors import PaveTwinError, describe, no_such

T = TypeVar("T")


class DuplicateNameError(ValueError):
    """A name is registered already."""


class BrokenRulesError(PaveTwinError):
    """Something of a user's own breaks rules of its kind. The message names the first."""

    def __init__(self, message: str, rules: Sequence[str]) -> None:
        super().__init__(message)
        self.rules = tuple(rules)
        """All of them, each as a sentence."""


def one_of(rules: Sequence[str]) -> str:
    """The end of a sentence about the first of several broken rules."""
    return f"breaks a rule: {rules[0]}" + (f" (and {len(rules) - 1} more)" if len(rules) > 1 else "")


class InstalledPackage(NamedTuple):
    """A distribution whose entry points register something."""

    name: str
    version: str

    @classmethod
    def of(cls, point: EntryPoint) -> "InstalledPackage":
        if point.dist is None:
            return cls(point.value, "")  # not from metadata of a distribution
        return cls(point.dist.name, point.dist.version)


@dataclass(eq=False)
class Source:
    """One reading of a plugin file or of an installed package, and what it registered."""

    name: str
    """Name in messages."""
    package: InstalledPackage | None = None
    """None for a file."""
    added: list[tuple["Registry[Any]", str, Any]] = field(default_factory=list)
    """Registry, name, and the entry that it replaced."""

    def broken_rules(self) -> Iterator[tuple[str, list[str]]]:
        """Registered values that break rules: each with its description, and the rules as sentences."""
        for registry, name, _ in self.added:
            if broken := registry.broken_rules(registry.get(name)):
                yield f"the {registry.what} '{name}'", broken

    def undo(self) -> None:
        """Take back what was registered, after a failure."""
        for registry, name, before in reversed(self.added):
            registry.restore(name, before)
        self.added.clear()


_reading: ContextVar[Source | None] = ContextVar("_reading", default=None)


@contextmanager
def reading(name: str, package: InstalledPackage | None = None) -> Iterator[Source]:
    """While the block runs, what is registered comes from `name`; all of it is taken back when the block fails."""
    source = Source(name, package)
    token = _reading.set(source)
    try:
        yield source
    except BaseException:
        source.undo()
        raise
    finally:
        _reading.reset(token)


@dataclass(frozen=True)
class _Entry(Generic[T]):
    value: T
    source: Source | None


class Registry(Generic[T]):
    """The known things of one kind, by name, in the order of registration."""

    def __init__(
        self,
        what: str,
        *,
        key: str,
        group: str,
        home: str,
        on_add: Callable[[str, T], None] = lambda _name, _value: None,
        rules: Callable[[T], list[str]] = lambda _: [],
    ) -> None:
        """Args:
        what: one of them in words, such as `label format`.
        key: the parameter that takes their names, such as `pattern.kind`; messages begin with it.
        group: of entry points of installed packages, such as `pavetwin.patterns`.
        home: the module, or the package of modules, that registers those that ship with PaveTwin.
        on_add: called with each name and value; may refuse with a ValueError.
        rules: function that returns the rules that a user's own breaks, each as a sentence.
        """
        self.what, self.group = what, group
        self.key = key if "." in key else f"`{key}`"  # settings have sections, parameters have options
        self._rules, self._home, self._on_add = rules, home, on_add
        self._entries: dict[str, _Entry[T]] = {}
        self._has_own = self._has_installed = False

    def register(self, name: str) -> Callable[[T], T]:
        """A decorator that adds what it decorates under `name`.

        Raises:
            DuplicateNameError: the name is taken. The same class or function, or the same file, read again may take its
                own name again.
        """
        return lambda value: self.add(name, value)

    def add(self, name: str, value: T) -> T:
        """Make `value` known under `name`; see `register`."""
        is_own = self._is_being_imported()
        source = None if is_own else _reading.get()
        if not is_own and (source or not str(getattr(value, "__module__", "")).startswith("pavetwin.")):
            self._load_own()  # they keep their names
        before = self._entries.get(name)
        if before is not None and not _is_read_again(before, value, source):
            by = f", by {before.source.name}" if before.source else ""
            raise DuplicateNameError(f"a {self.what} '{name}' is registered already{by}")
        self._on_add(name, value)
        if source is not None:
            source.added.append((self, name, before))
        self._entries[name] = _Entry(value, source)
        return value

    def get(self, name: str, *, instead: str = "") -> T:
        """The value registered as `name`.

        Args:
            instead: what may be given in place of a name, for the message.

        Raises:
            PaveTwinError: there is none; the message names the nearest and all known. Or an installed package fails.
        """
        self._load_own()
        if name not in self._entries:
            self._load_installed()
        if name not in self._entries:
            unknown = no_such(self.what, name, self._entries, key=self.key, instead=instead)
            raise PaveTwinError(f"{unknown} One of your own needs its file in `plugins`.")
        return self._entries[name].value

    def names(self) -> list[str]:
        """All names: those that ship with PaveTwin, then others in the order of registration.

        Raises:
            PaveTwinError: an installed package fails.
        """
        self._load_own()
        self._load_installed()
        return list(self._entries)

    def values(self, *, installed: bool = True) -> list[T]:
        """Values by name, or only those that no installed package adds."""
        if installed:
            return [self._entries[name].value for name in self.names()]
        self._load_own()
        return [entry.value for entry in self._entries.values() if not (entry.source and entry.source.package)]

    def package_of(self, name: str) -> InstalledPackage | None:
        """The installed package that gives what was found under a name; None for what ships with PaveTwin, comes from a
        file, or was not asked for yet."""
        entry = self._entries.get(name)
        return entry.source.package if entry is not None and entry.source is not None else None

    def broken_rules(self, value: T) -> list[str]:
        """The rules of its kind that a value breaks, each as a sentence; none when it keeps them."""
        return self._rules(value)

    def is_own(self, name: str) -> bool:
        """Whether a known name ships with PaveTwin."""
        return self._entries[name].source is None

    def restore(self, name: str, before: _Entry[T] | None) -> None:
        """Put back the entry that was replaced; None removes the name."""
        if before is None:
            self._entries.pop(name, None)
        else:
            self._entries[name] = before

    def _is_being_imported(self) -> bool:
        """Whether the home is being imported, even on behalf of a user's file: what it adds is not
        the user's."""
        spec = getattr(sys.modules.get(self._home), "__spec__", None)
        return bool(getattr(spec, "_initializing", False))

    def _load_own(self) -> None:
        if self._has_own:
            return
        self._has_own = True
        token = _reading.set(None)
        try:
            home = import_module(self._home)
            for module in iter_modules(getattr(home, "__path__", ())):
                import_module(f"{self._home}.{module.name}")
        finally:
            _reading.reset(token)

    def _load_installed(self) -> None:
        """Load the entry points of this group: a module that registers, or the thing itself, under its own name."""
        if self._has_installed:
            return
        self._has_installed = True
        for point in entry_points(group=self.group):
            package = InstalledPackage.of(point)
            with reading(f"the installed package '{package.name}'", package) as source:
                try:
                    value = point.load()
                    is_known = any(entry.value is value for entry in self._entries.values())
                    if not isinstance(value, ModuleType) and not is_known:
                        self.add(point.name, value)
                    fault = next((f"{what} {one_of(broken)}" for what, broken in source.broken_rules()), "")
                except Exception as error:
                    fault = describe(error)
                if fault:
                    raise PaveTwinError(f"{source.name} cannot give its {self.what} '{point.name}': {fault}.")


def packages_of(named: Iterable[tuple[Registry[Any], str]]) -> dict[str, str]:
    """Versions by name of the installed packages that give some things, which were found in their registries before."""
    found = {package for registry, name in named if (package := registry.package_of(name)) is not None}
    return {package.name: package.version for package in sorted(found) if package.version}


def _is_read_again(before: _Entry[T], value: T, source: Source | None) -> bool:
    """Whether a value is a known one whose file was read again."""
    if source is not None and before.source is not None:
        return before.source is not source and before.source.name == source.name
    old, new = (
        (getattr(each, "__module__", None), getattr(each, "__qualname__", None)) for each in (before.value, value)
    )
    return new[1] is not None and old == new and before.source is source

"""A user's own things from Python files: whatever a file registers, or a class that it holds, named `file.py:Class`.

A plugin file registers as the package's own modules do: `@policy("careful")`, `@defect_class("rutting", …)`. It is read
once in every process that works with it. What it does may depend on further files: those that it imports from next to
it, and data that it reads, which it declares, relative to itself:

```python
DATA_FILES = ["model.onnx"]
```

The content of all of them is part of what names a mission, a study or a dataset.
"""

import importlib.util
import sys
from collections.abc import Iterable
from functools import cache, lru_cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from pathlib import Path
from sysconfig import get_paths
from types import CodeType, ModuleType
from typing import Any, Final, TypeVar

from pavetwin.errors import PaveTwinError, describe, nearest_name
from pavetwin.files import file_sha256
from pavetwin.registry import BrokenRulesError, DuplicateNameError, Registry, one_of, reading

T = TypeVar("T")

KEY: Final = "`plugins`"
"""The parameter that takes plugin files, as messages name it."""

DATA_FILES: Final = "DATA_FILES"
"""Name in a user's module: the data files that it reads, relative to its file."""

_OWN: Final = "pavetwin_user_"
"""Prefix of the names of modules read from a user's file."""

_loaded: dict[Path, str] = {}
"""Plugin files that this process has read, with the hash of their content then."""

_registered: dict[Path, list[tuple[str, str]]] = {}
"""Registrations of each file when it was last read: kind and name."""


def load_plugins(paths: Iterable[str | Path], *, check: bool = True) -> None:
    """Read plugin files that this process has not read yet, or that have changed since.

    Args:
        check: what they register must keep the rules of its kind.

    Raises:
        PaveTwinError: one is not there, fails when read, takes a name that is taken, or registers what breaks a rule of
            its kind. Nothing of it is registered then.
    """
    for path in (Path(each).absolute() for each in paths):
        content = _hash(path, KEY)
        if _loaded.get(path) != content:
            _read(path, KEY, check=check)
            _loaded[path] = content


def registered_in(path: str | Path) -> list[tuple[str, str]]:
    """Registrations of a loaded plugin file: kind and name of each, such as ("policy", "careful")."""
    return _registered[Path(path).absolute()]


def plugin_hashes(paths: Iterable[str | Path]) -> dict[str, str]:
    """SHA-256 by path of plugin files, which have been loaded, and of all that `files_of` finds of them.

    Raises:
        PaveTwinError: a file cannot be read, or declared data is not there.
    """
    files = dict.fromkeys(file for path in paths for file in files_of(path))
    return {str(file): file_sha256(file) for file in files}


def find_class(registry: Registry[type[T]], base: Any, name: str) -> type[T]:
    """A registered class by its name, or a user's own as `path/to/file.py:ClassName`, a subclass of `base`.

    Raises:
        PaveTwinError: there is none, its file does not give one, or it breaks a rule of its kind.
    """
    path, colon, class_name = name.rpartition(":")
    if colon and path.endswith(".py"):
        file = Path(path)
        return _class_in(registry, base, file, class_name, _hash(file, registry.key))
    if name.endswith(".py"):
        raise PaveTwinError(f"{registry.key}: '{name}' names no class; write {name}:ClassName.")
    return registry.get(name, instead=", or path/to/file.py:ClassName")


def files_of(path: str | Path) -> list[Path]:
    """A user's file, which has been loaded, and the files that its work may depend on.

    These are the imported modules' files in or below its folder, and the `DATA_FILES` that it or one of them declares.
    Installed packages and other plugin files are left out.

    Raises:
        PaveTwinError: declared data is not there.
    """
    path = Path(path).absolute()
    helpers = _helpers_of(path)
    modules = [(path, sys.modules.get(_module_name(path))), *sorted(helpers.items())]
    data = {file for source, module in modules for file in _data_files(source, module, KEY)}
    return list(dict.fromkeys([path, *sorted(helpers), *sorted(data)]))


def _helpers_of(path: Path) -> dict[Path, ModuleType]:
    """Modules in the folder of a user's file, or below, that it may have imported, by file."""
    folder, installed = path.resolve().parent, [Path(place).resolve() for place in set(get_paths().values())]
    found = {}
    for name, module in list(sys.modules.items()):
        source = getattr(module, "__file__", None)
        if not source or name.partition(".")[0] in ("__main__", "pavetwin") or name.startswith(_OWN):
            continue
        file = _resolved(source)
        if folder in file.parents and not any(place in file.parents for place in installed):
            found[file] = module
    return found


@cache
def _resolved(source: str) -> Path:
    return Path(source).resolve()


def _data_files(source: Path, module: ModuleType | None, key: str) -> list[Path]:
    """The data that a module declares to read.

    Raises:
        PaveTwinError: the declaration is not a list of names, or a file does not exist.
    """
    names = getattr(module, DATA_FILES, ())
    if not isinstance(names, list | tuple) or not all(isinstance(name, str | Path) for name in names):
        raise PaveTwinError(f"{key}: '{source}': {DATA_FILES} must be a list of file names, as in [\"model.onnx\"].")
    files = [source.parent / name for name in names]
    if missing := [file for file in files if not file.is_file()]:
        raise PaveTwinError(f"{key}: '{source}': {DATA_FILES} names '{missing[0]}', and there is no such file.")
    return files


@lru_cache(maxsize=64)
def _class_in(registry: Registry[type[T]], base: Any, path: Path, class_name: str, _content: str) -> type[T]:
    """Read again when the file's content has changed, which is its last argument."""
    module = _read(path, registry.key)
    kind: Any = getattr(module, class_name, None)
    if not (isinstance(kind, type) and issubclass(kind, base)):
        own = [value for value in vars(module).values() if getattr(value, "__module__", "") == module.__name__]
        near = nearest_name(class_name, [it.__name__ for it in own if isinstance(it, type) and issubclass(it, base)])
        raise PaveTwinError(
            f"{registry.key}: '{path}' has no {registry.what} class '{class_name}'{near}. "
            f"It must be a subclass of {base.__module__.rpartition('.')[0]}.{base.__name__}."
        )
    if broken := registry.broken_rules(kind):
        raise BrokenRulesError(f"{registry.key}: '{path}:{class_name}' {one_of(broken)}.", broken)
    found: type[T] = kind
    return found


class _Uncached(SourceFileLoader):
    """Always compiles the source: leaves no `__pycache__` in the user's folder, and reads none that is stale."""

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - the signature of a loader
        return self.source_to_code(self.get_data(self.path), self.path)


def _read(path: Path, key: str, *, check: bool = False) -> ModuleType:
    """The module of a user's file; with `check`, what it registers must keep the rules of its kind."""
    name = _module_name(path)
    loader = _Uncached(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    if spec is None:
        raise PaveTwinError(f"{key}: '{path}' cannot be read as Python.")
    module = importlib.util.module_from_spec(spec)
    before = sys.modules.get(name)
    sys.modules[name] = module
    beside = str(path.resolve().parent)
    try:
        sys.path.insert(0, beside)  # as a script does
        with reading(f"'{path.resolve()}'") as source:
            loader.exec_module(module)
            _data_files(path, module, key)
            for what, broken in source.broken_rules() if check else ():
                raise BrokenRulesError(f"{key}: '{path}': {what} {one_of(broken)}.", broken)
        _registered[path] = [(registry.what, name) for registry, name, _ in source.added]
    except BaseException as error:
        del sys.modules[name]
        if before is not None:
            sys.modules[name] = before
        if isinstance(error, DuplicateNameError):
            raise PaveTwinError(f"{key}: '{path}' cannot be used: {error}.") from error
        if isinstance(error, PaveTwinError) or not isinstance(error, Exception | SystemExit):
            raise
        raise PaveTwinError(f"{key}: '{path}' fails when read: {describe(error)}.") from error
    finally:
        sys.path.remove(beside)
    return module


def _module_name(path: Path) -> str:
    """Module name of a user's file. Two files of the same name in different folders are two modules."""
    return f"{_OWN}{path.stem}_{sha256(str(path.resolve()).encode()).hexdigest()[:8]}"


def _hash(path: Path, key: str) -> str:
    try:
        return sha256(path.read_bytes()).hexdigest()
    except FileNotFoundError as error:
        raise PaveTwinError(f"{key}: there is no file '{path}'.") from error
    except OSError as error:
        raise PaveTwinError(f"{key}: cannot read '{path}': {error.strerror}.") from error

"""The user's cache: recordings, NavMeshes, textures, tiles, placed defects, splits, and values computed from a world.

A world's folder may be read-only and stays as it was built. The folder in the cache is named by the world's content
hash: a changed world never reads what was made from another. The cache has a bound: the files not used for longest are
removed first.

A file of a `ValueStore` holds one compressed value, and its path covers all that the value depends on, among it the
code, data and libraries that make it. A damaged file is made again; where none can be written, each process makes its
own. A `CacheWarning` reports either once.
"""

import hashlib
import io
import os
import pickle
import shutil
import struct
import time
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from enum import Enum
from functools import cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar, get_args

import numpy as np
import shapely

from pavetwin._core import __file__ as kernel_file
from pavetwin.arrays import __file__ as arrays_file
from pavetwin.errors import CacheWarning, PaveTwinError
from pavetwin.files import file_lock, file_sha256, unwritable, writing
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World

SIZE_VARIABLE: Final = "PAVETWIN_CACHE_GB"
"""Environment variable: the most that the cache holds, in GB."""

MOST_GB: Final = 4.0
"""Default of `SIZE_VARIABLE`: the tiles of some 1,500 places."""

LEFT_FREE: Final = 0.1
"""Share of the bound that is freed when it is reached, so that it is not reached again at once."""

IN_USE_S: Final = 86_400.0
"""Files of worlds that were used within this time are not removed: a mission may be reading them."""


CacheSection = Literal["worlds", "textures", "tiles", "defects", "splits"]
"""Folders of the cache: recordings and NavMeshes by world, textures that all worlds share, tiles of scenes and their
ingredients, defects placed on segments, splits of streets for datasets."""


def cache_folder(section: CacheSection | Literal[""] = "") -> Path:
    """Folder of the cache: `PAVETWIN_CACHE`, or `pavetwin` in the user's cache (`XDG_CACHE_HOME`, `~/.cache`)."""
    own = os.environ.get(CACHE_VARIABLE)
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return (Path(own).absolute() if own else users / "pavetwin") / section


def cached(world: World, file: str) -> Path:
    """The place in the cache of a file that is made from a world; its use is noted.

    Args:
        file: path within the world's part of the cache, such as `traffic/high-1.parquet`.

    Raises:
        PaveTwinError: the world was never saved.
    """
    folder = world.network_file.parent
    path = cache_folder("worlds") / (world.content_hash[:16] or folder.name) / file
    mark_used(path)
    return path


def mark_used(path: Path) -> None:
    """Note that a file of the cache is used now, if it is there: many file systems do not note when a file is read."""
    with suppress(OSError):
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))


def most_bytes() -> int:
    """Bound of the cache in bytes.

    Raises:
        PaveTwinError: `PAVETWIN_CACHE_GB` is not a number above 0.
    """
    stated = os.environ.get(SIZE_VARIABLE, "")
    try:
        most = 1e9 * float(stated or MOST_GB)
        if 0 < most < float("inf"):
            return int(most)
    except ValueError:
        pass
    raise PaveTwinError(f"{SIZE_VARIABLE} is '{stated}'; give the most that the cache may hold in GB, such as 4.")


def cache_size() -> tuple[int, int]:
    """Number of worlds in the cache, and bytes of all its files."""
    folder = cache_folder("worlds")
    worlds = sum(path.is_dir() for path in folder.iterdir()) if folder.is_dir() else 0
    return worlds, sum(status.st_size for _, status in _files())


def make_room() -> None:
    """Remove the files that were not used for longest, if the cache holds more than it may.

    Raises:
        PaveTwinError: as `most_bytes`.
    """
    most, files = most_bytes(), list(_files())
    held = sum(status.st_size for _, status in files)
    if held <= most:
        return
    worlds, in_use = cache_folder("worlds"), time.time() - IN_USE_S
    for path, status in sorted(files, key=lambda file: _last_use(file[1])):
        if held <= (1 - LEFT_FREE) * most:
            break
        if path.is_relative_to(worlds) and _last_use(status) > in_use:
            continue
        with suppress(OSError):  # another process may have removed it
            path.unlink()
            held -= status.st_size
            path.parent.rmdir()  # unless another file is in it


def _last_use(status: os.stat_result) -> float:
    return max(status.st_atime, status.st_mtime)


def _files() -> Iterator[tuple[Path, os.stat_result]]:
    """Complete files of the cache; foreign files are left out."""
    # Other processes make and remove folders meanwhile; `os.walk` passes over what is gone.
    for folder, _, names in chain.from_iterable(map(os.walk, map(cache_folder, get_args(CacheSection)))):
        for path in (Path(folder, name) for name in names if not name.startswith(".")):
            with suppress(OSError):
                yield path, path.stat()


def clear_cache() -> None:
    """Remove all files from the cache that are ours; they are made again when they are needed.

    Raises:
        PaveTwinError: something cannot be removed.
    """
    for folder in map(cache_folder, get_args(CacheSection)):
        try:
            if folder.is_dir():
                shutil.rmtree(folder)
        except OSError as error:
            raise PaveTwinError(f"Cannot clear the cache: {unwritable(folder, error)}") from error


LIBRARIES: Final = ("numpy", "scipy", "shapely", "opencv-python-headless", "pillow")

CODEC: Final = "lz4"
"""Reads a tile's maps, 8 MB, in 3 ms, and makes 2.7 MB of them; zstd makes 1.8 MB and takes 7 ms."""

ROOM_AFTER_BYTES: Final = 200_000_000
"""The size of the cache is looked at whenever a process has written so much into it, and at its first file."""

LOCK_TIMEOUT_S: Final = 60.0
"""Longest wait for another process that makes the same value."""

_HEADER: Final = struct.Struct("<8sIQ")
"""Kind of file, CRC-32 of the compressed content, and length of the decompressed content."""

_KIND: Final = b"pavekept"

Value = TypeVar("Value")


class ValueStore:
    """Reads and writes values of some classes."""

    def __init__(self, values: str, classes: Iterable[Any]) -> None:
        """Args:
        values: what they are, in the plural, as warnings name them.
        classes: theirs, besides arrays, shapes and plain containers. A file can name no others, so it can run no code.
        """
        self._values = values
        known = (_fixed, *_READERS, *classes)
        self._known = {(each.__module__, each.__qualname__): each for each in known}

    def kept(self, path: Path, make: Callable[[], Value]) -> Value:
        """A value from its file, else made and written. Where another process makes it now, this one waits for it."""
        found: list[Value] = self._found(path)
        if not found:
            with file_lock(path, LOCK_TIMEOUT_S):
                found = self._found(path) or [self._made(path, make)]
        return found[0]

    def _found(self, path: Path) -> list[Any]:
        """The value of a file, if there is one that can be read."""
        try:
            value = self._read(path)
        except FileNotFoundError:
            return []
        except OSError as error:
            why = error.strerror or error
            _warn(f"The cache '{cache_folder()}' cannot be read ({why}): its {self._values} are made again.")
            return []
        except Exception:  # whatever a damaged file makes of the codec and of pickle
            _warn(f"The cache '{cache_folder()}' holds damaged {self._values}; they are made again.")
            return []
        mark_used(path)
        return [value]

    def _made(self, path: Path, make: Callable[[], Value]) -> Value:
        value = make()
        try:
            write(path, value)
        except PaveTwinError as error:
            why = getattr(error.__cause__, "strerror", None) or str(error)
            _warn(
                f"The cache '{cache_folder()}' cannot be written ({why}): {self._values} are made again by every "
                f"command. {CACHE_VARIABLE} names another folder."
            )
        return value

    def _read(self, path: Path) -> Any:
        import pyarrow as pa

        data = path.read_bytes()
        kind, crc, size = _HEADER.unpack_from(data)
        packed = memoryview(data)[_HEADER.size :]
        if kind != _KIND or zlib.crc32(packed) != crc:
            raise ValueError("it is not whole")
        return _Unpickler(io.BytesIO(pa.decompress(packed, size, codec=CODEC)), self._known).load()


@cache
def made_by(*folders: str) -> str:
    """Hash of the code, the data and the libraries that make values.

    Args:
        folders: of the package, whose code and data decide.
    """
    package = Path(arrays_file).parent
    files = [package / "seeds.py", Path(arrays_file)]
    for folder in folders:
        found = (package / folder).rglob("*")
        files += sorted(path for path in found if _is_source(path.relative_to(package)) and path.is_file())
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(package)} ".encode() + path.read_bytes())
    digest.update(file_sha256(Path(kernel_file)).encode())
    for library in LIBRARIES:
        digest.update(f"{library} {version(library)} ".encode())
    digest.update(shapely.geos_version_string.encode())
    return digest.hexdigest()


def short_sha256(text: str) -> str:
    """The beginning of a hash, which names a file or folder of the cache."""
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _is_source(path: Path) -> bool:
    """Whether a path within the package is of its code or data: not of bytecode, which appears and goes while other
    processes start, nor hidden."""
    return "__pycache__" not in path.parts and not path.name.startswith(".")


_written_bytes = ROOM_AFTER_BYTES


def write(path: Path, value: object) -> None:
    """Write a value to its file, whole or not at all.

    Raises:
        PaveTwinError: it cannot be written.
    """
    global _written_bytes
    import pyarrow as pa

    file = io.BytesIO()
    _Pickler(file, protocol=5).dump(value)
    whole = file.getvalue()
    packed = pa.compress(whole, codec=CODEC, asbytes=True)
    with writing(path) as temporary:
        temporary.write_bytes(_HEADER.pack(_KIND, zlib.crc32(packed), len(whole)) + packed)
    _written_bytes += len(packed)
    if _written_bytes >= ROOM_AFTER_BYTES:
        _written_bytes = 0
        make_room()


def _fixed(values: dict[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(values)


class _Pickler(pickle.Pickler):
    """Writes mappings that cannot be changed, too, and members of enumerations by their value: Python 3.11.2 writes
    them by name and `getattr`, which `_Unpickler` does not know."""

    dispatch_table = MappingProxyType({MappingProxyType: lambda values: (_fixed, (dict(values),))})

    def reducer_override(self, each: object, /) -> Any:
        return (type(each), (each.value,)) if isinstance(each, Enum) else NotImplemented


class _Unpickler(pickle.Unpickler):
    """Reads values of known classes and no others."""

    def __init__(self, file: io.BytesIO, known: Mapping[tuple[str, str], Any]) -> None:
        super().__init__(file)
        self._known = known

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        with suppress(KeyError):
            return self._known[module_name, global_name]
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is not kept in the cache")


# The functions by which arrays, their scalars and shapes are read; where they are differs between versions.
_SAMPLES: Final[tuple[Any, ...]] = (np.zeros(1), np.empty(1, dtype=object), np.float64(0), shapely.Point(0, 0))
_READERS: Final = (np.ndarray, np.dtype, *(sample.__reduce_ex__(5)[0] for sample in _SAMPLES))


def _warn(text: str) -> None:
    warnings.warn(text, CacheWarning, stacklevel=5)

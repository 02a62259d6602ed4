"""Tiles of a scene, and what they are made from, kept in the cache between runs.

A file holds one value, compressed, and is named by all that the value depends on: the world and its defects, the look
and the seed, and the code, data and libraries that make it. A file that is damaged is made again; where none can be
written, each process makes its own. Either is said once, by a `CacheWarning`.
"""

import hashlib
import io
import pickle
import struct
import warnings
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

import numpy as np
import pyarrow as pa
import shapely

from pavetwin import _core, arrays, seeds
from pavetwin.errors import CacheWarning, PaveTwinError
from pavetwin.files import file_sha256, writing
from pavetwin.scene import model
from pavetwin.scene.ground.distractors.fixtures import Fixture
from pavetwin.scene.ground.distractors.segment_marks import Repairs
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.looks import look_sha256, street_look
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.plan import made
from pavetwin.world.cache import cache_folder, make_room, mark_used, tile_folder
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World

MADE_BY: Final = ("scene", "defects", "world")
"""The folders of the package whose code and data decide what is kept here."""

LIBRARIES: Final = ("numpy", "scipy", "shapely", "opencv-python-headless", "pillow")

CODEC: Final = "lz4"
"""Reads a tile's maps, 8 MB, in 3 ms, and makes 2.7 MB of them; zstd makes 1.8 MB and takes 7 ms."""

ROOM_AFTER_BYTES: Final = 200_000_000
"""The size of the cache is looked at whenever a process has written so much into it, and at its first file."""

_HEADER: Final = struct.Struct("<8sIQ")
"""What the file is, the CRC-32 of what follows, and the length of that when it is decompressed."""

_KIND: Final = b"pavetile"

Value = TypeVar("Value")


class SceneCache:
    """What is kept of one scene."""

    def __init__(self, world: World, *, seed: int, look: str) -> None:
        """Args:
        world: with its defects. Of one that was never built or loaded, and so has no content hash, nothing is kept.
        look: of its streets: a name, or a YAML file.
        """
        self._folder: Path | None = None
        if world.content_hash:
            beside_hash = [(street.latin_name, street.bridges) for street in world.streets]
            inputs = (world.content_hash, world.defects_hash, beside_hash, seed, look_sha256(look), street_look(look))
            self._folder = tile_folder() / _sha256(f"{inputs!r} {made_by()}")

    def kept(self, name: str, make: Callable[[], Value], /) -> Value:
        """A value: from its file, else made and written.

        Args:
            name: of the value in this scene; a path where there are many.
            make: gives one of the classes that are listed in this module, or a container of such.
        """
        return made(name, make) if self._folder is None else _kept(self._folder / name, make)


def kept_of_all(name: str, make: Callable[[], Value]) -> Value:
    """A value that is the same in every scene, as `SceneCache.kept` keeps others."""
    return _kept(tile_folder() / _sha256(made_by()) / name, make)


def _kept(path: Path, make: Callable[[], Value]) -> Value:
    """A value from its file, else made and written."""
    try:
        found: Value = _read(path)
    except FileNotFoundError:
        pass
    except OSError as error:
        _warn(f"The cache '{cache_folder()}' cannot be read ({error.strerror or error}): its tiles are made again.")
    except Exception:  # whatever a damaged file makes of the codec and of pickle
        _warn(f"Tiles in the cache '{cache_folder()}' are damaged; they are made again.")
    else:
        mark_used(path)
        return found
    value = make()
    try:
        _write(path, value)
    except PaveTwinError as error:
        why = getattr(error.__cause__, "strerror", None) or str(error)
        _warn(
            f"The cache '{cache_folder()}' cannot be written ({why}): tiles of the ground are made again by every "
            f"command. {CACHE_VARIABLE} names another folder."
        )
    return value


@cache
def made_by() -> str:
    """Hash of the code, the data and the libraries that make what is kept here."""
    package = Path(model.__file__).parent.parent
    files = [Path(str(module.__file__)) for module in (seeds, arrays)]
    for folder in MADE_BY:
        found = (package / folder).rglob("*")
        files += sorted(path for path in found if _is_source(path.relative_to(package)) and path.is_file())
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(package)} ".encode() + path.read_bytes())
    digest.update(file_sha256(Path(str(_core.__file__))).encode())
    for library in LIBRARIES:
        digest.update(f"{library} {version(library)} ".encode())
    digest.update(shapely.geos_version_string.encode())
    return digest.hexdigest()


def _is_source(path: Path) -> bool:
    """Whether a path within the package is of its code or data: not of bytecode, which appears and goes while other
    processes start, nor hidden."""
    return "__pycache__" not in path.parts and not path.name.startswith(".")


def _read(path: Path) -> Any:
    data = path.read_bytes()
    kind, crc, size = _HEADER.unpack_from(data)
    packed = memoryview(data)[_HEADER.size :]
    if kind != _KIND or zlib.crc32(packed) != crc:
        raise ValueError("it is not whole")
    return _Unpickler(io.BytesIO(pa.decompress(packed, size, codec=CODEC))).load()


_written_bytes = ROOM_AFTER_BYTES


def _write(path: Path, value: object) -> None:
    global _written_bytes
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
    """Writes mappings that cannot be changed, too."""

    dispatch_table = MappingProxyType({MappingProxyType: lambda values: (_fixed, (dict(values),))})


class _Unpickler(pickle.Unpickler):
    """Reads values of the classes below and no others, so that a file of the cache can run no code."""

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        with suppress(KeyError):
            return _KNOWN[module_name, global_name]
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is not kept in the cache")


def _known() -> Mapping[tuple[str, str], Any]:
    of_ours: tuple[Any, ...] = (
        *(model.Tile, model.GroundPiece, model.FacadePiece, model.Instance, model.Mesh, model.Finish),
        *(model.GroundKind, model.GroundMaps, model.DefectPatch, model.Model),
        *(_fixed, Fixture, Paint, PavedSurface, Repairs),
    )
    # The functions by which arrays, their scalars and shapes are read; where they are differs between versions.
    samples: tuple[Any, ...] = (np.zeros(1), np.empty(1, dtype=object), np.float64(0), shapely.Point(0, 0))
    readers = (np.ndarray, np.dtype, *(sample.__reduce_ex__(5)[0] for sample in samples))
    return MappingProxyType({(each.__module__, each.__qualname__): each for each in (*of_ours, *readers)})


_KNOWN: Final = _known()


def _warn(text: str) -> None:
    warnings.warn(text, CacheWarning, stacklevel=4)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:24]

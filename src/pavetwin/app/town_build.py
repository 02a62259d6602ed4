"""Towns built from maps that a browser sent, within limits of size and time."""

import re
import resource
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO, Final, NoReturn

import numpy as np
import shapely

from pavetwin.app.requests import KINDS, LARGEST_KM2
from pavetwin.defects.placement import build_folder
from pavetwin.errors import PaveTwinError
from pavetwin.world.build import BuildOptions
from pavetwin.world.network import is_street
from pavetwin.world.osm_file import osm_objects
from pavetwin.world.roadnet import read_roadnet

LARGEST_UNPACKED_BYTES: Final = 500_000_000

_LARGEST_HEADER, _LARGEST_BLOB = 1 << 16, 1 << 25
"""Bytes, as the PBF format has it."""

_FORBIDDEN: Final = re.compile(rb"<!DOCTYPE|<!ENTITY|<(?:\w{1,40}:)?include\b|\0")
"""Declarations, inclusions of other files, and other encodings than those below."""

_ENCODINGS: Final = (b"utf-8", b"us-ascii", b"ascii", b"iso-8859-1")

_KM_PER_DEGREE: Final = 111.32

_BLOCK: Final = 1 << 20


def check_map(source: Path) -> None:
    """Refuse a map that does not match its suffix, or that is too large.

    Raises:
        PaveTwinError: in one line.
    """
    is_packed = source.name.endswith(".osm.pbf")
    if is_packed:
        _check_unpacked(source)
    else:
        _check_plain(source)
    corners = _net_corners(source) if source.name.endswith(".net.xml") else _street_corners(source)
    if corners is None:
        return  # building reports the cause
    (west, south), (east, north) = corners
    km2 = (east - west) * (north - south)
    if km2 > LARGEST_KM2:
        raise PaveTwinError(
            f"The streets of '{source.name}' spread over {km2:.0f} km², and the page builds up to {LARGEST_KM2:g} km²; "
            "cut out a smaller area, or build it with `pavetwin world build`."
        )


def _check_plain(source: Path) -> None:
    overlap = 64
    with source.open("rb") as file:
        head = file.read(_BLOCK)
        if head.startswith(b"\x1f\x8b"):
            raise PaveTwinError(f"'{source.name}' is compressed with gzip; unpack it first.")
        if not head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
            raise PaveTwinError(f"'{source.name}' is not XML, which {_suffix(source)} stands for.")
        declared = re.match(rb"\s*<\?xml[^>]*?encoding\s*=\s*[\"']([^\"']+)", head.removeprefix(b"\xef\xbb\xbf"))
        if declared is not None and declared[1].lower() not in _ENCODINGS:
            raise PaveTwinError(f"'{source.name}' is not in UTF-8; save it in that encoding.")
        block = head
        while block:
            if _FORBIDDEN.search(block):
                raise PaveTwinError(
                    f"'{source.name}' declares entities, includes other files or is not in UTF-8; the page takes plain "
                    "maps alone."
                )
            following = file.read(_BLOCK)
            block = block[-overlap:] + following if following else b""


def _check_unpacked(source: Path) -> None:
    unpacked = 0
    with source.open("rb") as file:
        for size in _blob_sizes(file, source.name):
            unpacked += size
            if unpacked > LARGEST_UNPACKED_BYTES:
                raise PaveTwinError(
                    f"'{source.name}' holds more than {LARGEST_UNPACKED_BYTES // 10**6} MB when it is unpacked; cut "
                    "out a smaller area, or build it with `pavetwin world build`."
                )


def _blob_sizes(file: BinaryIO, shown: str) -> Iterator[int]:
    """Bytes of each blob when unpacked, as it states them: who unpacks it makes room for these and no more.

    https://wiki.openstreetmap.org/wiki/PBF_Format
    """
    damaged = PaveTwinError(f"'{shown}' is no .osm.pbf, or is cut short: download it again.")
    while prefix := file.read(4):
        header_bytes = int.from_bytes(prefix, "big")
        header = file.read(header_bytes) if len(prefix) == 4 and 0 < header_bytes <= _LARGEST_HEADER else b""
        if len(header) != header_bytes or not header:
            raise damaged
        try:
            blob_bytes = max((value for field, value in _fields(header) if field == 3 and isinstance(value, int)))
            blob = file.read(blob_bytes) if 0 <= blob_bytes <= _LARGEST_BLOB else b""
            if len(blob) != blob_bytes:
                raise damaged
            # Field 1: not compressed; field 2: the size of what is compressed in another field.
            yield max(
                (value if isinstance(value, int) else len(value) for field, value in _fields(blob) if field in (1, 2)),
                default=0,
            )
        except (ValueError, IndexError) as error:
            raise damaged from error


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and value of the fields of a Protocol Buffers message.

    Raises:
        ValueError, IndexError: the bytes are not such a message.
    """
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                value, at = _varint(message, at)
                yield key >> 3, value
            case 2:
                size, at = _varint(message, at)
                if at + size > len(message):
                    raise ValueError("cut short")
                yield key >> 3, message[at : at + size]
                at += size
            case 1 | 5 as wire:
                at += 8 if wire == 1 else 4
            case other:
                raise ValueError(f"wire type {other}")


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 64, 7):
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("too long a number")


Corners = tuple[tuple[float, float], tuple[float, float]]
"""South-west and north-east, in kilometres from some place."""


def _street_corners(source: Path) -> Corners | None:
    """Corners of the nodes of streets; None without any."""
    wanted: set[int] = set()
    for way in osm_objects(source, only_ways=True):
        if is_street(way.tags):
            wanted.update(node.ref for node in way.nodes)
    west = south = np.inf
    east = north = -np.inf
    for item in osm_objects(source) if wanted else ():
        if item.is_node() and item.id in wanted and item.location.valid():
            west, east = min(west, item.lon), max(east, item.lon)
            south, north = min(south, item.lat), max(north, item.lat)
    if west > east:
        return None
    per_longitude = _KM_PER_DEGREE * np.cos(np.radians((south + north) / 2))
    return (west * per_longitude, south * _KM_PER_DEGREE), (east * per_longitude, north * _KM_PER_DEGREE)


def _net_corners(source: Path) -> Corners | None:
    """Corners of all lanes; None without any."""
    net = read_roadnet(source, shown_as=source.name)
    lines = [lane.centre_line for edge in net.edges.values() for lane in edge.lanes]
    if not lines:
        return None
    west, south, east, north = (float(each) / 1000 for each in shapely.total_bounds(lines))
    return (west, south), (east, north)


def _suffix(source: Path) -> str:
    return next(kind for kind in KINDS if source.name.endswith(kind))


MEMORY_BYTES: Final = 4 << 30
"""Address space of this process, and of each that it starts."""

PROCESSOR_S: Final = 600
"""Limit of this process, and of each that it starts."""

FILE_BYTES: Final = 2 << 30
"""The largest file that is written."""


def build_town(source: Path, folder: Path, options: dict[str, Any], report: Callable[[float, str], None]) -> None:
    """Build a world as `pavetwin world build` does, within limits; this process is of no use afterwards.

    Args:
        source: the map, in a folder for temporary files.
        folder: of the new world.
        options: `left_hand` and `parking_rule`.

    Raises:
        PaveTwinError: the map is refused, or no world comes of it.
    """
    tempfile.tempdir = str(source.parent)
    _limit()
    report(0.0, "Checking the map")
    try:
        check_map(source)
        chosen = BuildOptions.parse(options, where="the page")
        build_folder(
            source, folder, chosen, on_progress=lambda share, what: report(share, f"Building the town: {what}")
        )
    except PaveTwinError as error:
        raise PaveTwinError(str(error).replace(f"{source.parent}/", "")) from error


def _limit() -> None:
    signal.signal(signal.SIGXCPU, _too_long)
    for what, most, beyond in (
        (resource.RLIMIT_AS, MEMORY_BYTES, 0),
        (resource.RLIMIT_CPU, PROCESSOR_S, 30),
        (resource.RLIMIT_FSIZE, FILE_BYTES, 0),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        hard = resource.getrlimit(what)[1]
        is_lower = hard != resource.RLIM_INFINITY and hard < most + beyond
        resource.setrlimit(what, (min(most, hard) if is_lower else most, hard if is_lower else most + beyond))


def _too_long(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of a handler
    raise PaveTwinError(
        f"Building it takes more than {PROCESSOR_S // 60} minutes of processor time; cut out a smaller area."
    )

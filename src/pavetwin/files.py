"""Files written whole or not at all: to a temporary name beside the target, then renamed. And their hashes."""

import errno
import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from platform import node
from re import sub
from types import ModuleType
from typing import Any, Final

from pavetwin.errors import PaveTwinError

PICTURE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
"""Of pictures that are read, in lower case."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""A full disk, a used-up quota, and a file that may not grow."""

FORMAT: Final = 1
"""The format of every file and folder that PaveTwin writes and reads."""

_LOOKED_AGAIN_S = 0.003
"""How often it is looked whether another process has ended with a file."""


def check_format(found: object, what: str) -> None:
    """Refuse a file or folder whose format is not `FORMAT`.

    Args:
        found: the format that it states; None if it states none.
        what: subject of the message, such as "The recording 'day.parquet'".

    Raises:
        PaveTwinError: `found` is not the number 1.
    """
    if type(found) is not int or found != FORMAT:
        stated = "has no format number" if found is None else f"has format {found}"
        raise PaveTwinError(f"{what} {stated}; this version reads only format {FORMAT}. Create it again.")


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's content; read again only when its size or time has changed.

    Raises:
        PaveTwinError: it cannot be read.
    """
    try:
        stat = path.stat()
        return _digest(str(path), stat.st_size, stat.st_mtime_ns)
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{path}': {error.strerror or error}.") from error


@lru_cache(maxsize=64)
def _digest(path: str, size: int, changed_ns: int) -> str:  # noqa: ARG001 - they are the cache's key
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def writing(target: Path) -> Iterator[Path]:
    """A temporary path with the target's suffix, moved onto `target` when the block ends without an exception.

    Raises:
        PaveTwinError: the folder cannot be made or written, or the disk is full. Nothing is left behind.
    """
    temporary = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _clear_killed(target)
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f"{_mark(target)}{os.getpid()}-", suffix=target.suffix
        )
        os.close(handle)
        temporary = Path(name)
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(target)
    except OSError as error:
        raise unwritable(target, error) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def check_folder(folder: Path) -> None:
    """Whether files can be written into a folder, which need not be there yet: before long work of which they tell.

    Raises:
        PaveTwinError: it is a file, lies below one, or may not be written.
    """
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not there.is_dir():
        raise PaveTwinError(f"'{there}' is a file, so that nothing can be written into '{folder}'; name a folder.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PaveTwinError(f"'{there}' may not be written; name another folder than '{folder}'.")


def check_target(file: Path) -> None:
    """The same of a file.

    Raises:
        PaveTwinError: it is a folder, or its folder is a file or may not be written.
    """
    if file.is_dir():
        raise PaveTwinError(f"'{file}' is a folder; name a file in it.")
    check_folder(file.parent)


def write_pieces(target: Path, pieces: Iterable[bytes]) -> None:
    """Write a file piece by piece: whole, or not at all, as `writing` does."""
    with writing(target) as temporary, temporary.open("wb") as stream:
        stream.writelines(pieces)


def json_bytes(value: object) -> bytes:
    """A value as JSON in UTF-8."""
    return json.dumps(value, ensure_ascii=False).encode()


def json_rows(rows: Iterable[Mapping[str, Any]]) -> Iterator[bytes]:
    """The elements of a long list of JSON, one a line, without its brackets."""
    for number, row in enumerate(rows):
        yield (b",\n" if number else b"") + json_bytes(row)


@contextmanager
def writing_folder(target: Path, *, replace: bool = False) -> Iterator[Path]:
    """A temporary folder, moved onto `target` when the block ends without an exception.

    Raises:
        PaveTwinError: `target` exists and `replace` is false, or it cannot be written. Nothing is left behind.
    """
    if target.exists() and not replace and (not target.is_dir() or any(target.iterdir())):
        raise PaveTwinError(f"'{target}' exists already; choose another name, or replace it (`force`).")
    try:
        with _temporary_folder(target) as temporary:
            yield temporary
            temporary.chmod(0o755)
            if target.exists():
                shutil.rmtree(target)
            temporary.replace(target)
    except OSError as error:
        raise unwritable(target, error) from error


@contextmanager
def staging_folder(target: Path) -> Iterator[Path]:
    """A temporary folder beside `target`, for files that are whole before they are moved to their places.

    Raises:
        PaveTwinError: it cannot be made, or the block failed to write. The folder is gone afterwards.
    """
    try:
        with _temporary_folder(target) as temporary:
            yield temporary
    except OSError as error:
        raise unwritable(target.parent, error) from error


@contextmanager
def _temporary_folder(target: Path) -> Iterator[Path]:
    """A folder beside `target`; gone at the end of the block, unless it was renamed."""
    target.parent.mkdir(parents=True, exist_ok=True)
    _clear_killed(target)
    temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f"{_mark(target)}{os.getpid()}-"))
    try:
        yield temporary
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def link_or_copy(source: Path, target: Path) -> None:
    """A hard link to a file; a copy on file systems without hard links."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        with writing(target) as temporary:
            shutil.copyfile(source, temporary)


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """While the block runs, no other process that asks the same works in `folder`, which need not exist.

    A hidden file beside the folder is locked, and gone afterwards. Where the system has no such locks (Windows),
    nothing is guarded.

    Raises:
        PaveTwinError: another process is at work there, or nothing can be written beside the folder.
    """
    try:
        locks = import_module("fcntl")
    except ImportError:
        yield
        return
    path = folder.absolute().parent / f".{folder.absolute().name}.lock"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = _locked(path, locks)
    except BlockingIOError as error:
        raise PaveTwinError(
            f"Another process is at work in '{folder}'; wait for its end or choose another folder."
        ) from error
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path, locks: ModuleType) -> int:
    """The handle of a lock file that is ours, and that no one has removed in the moment before we locked it."""
    while True:
        handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o644)
        try:
            locks.flock(handle, locks.LOCK_EX | locks.LOCK_NB)
            if path.exists() and os.path.samestat(os.fstat(handle), path.stat()):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


@contextmanager
def file_lock(target: Path, timeout_s: float) -> Iterator[None]:
    """While the block runs, no other process or thread that asks the same makes `target`; waits until then.

    A hidden file beside the target is locked, and gone afterwards. Where there can be no such file, nobody waits.

    Args:
        timeout_s: whoever has waited so long goes on beside the other, which may hang.
    """
    handle, until = None, time.monotonic() + timeout_s
    path = target.with_name(f".{target.name}.lock")
    with suppress(ImportError, OSError):
        locks = import_module("fcntl")
        path.parent.mkdir(parents=True, exist_ok=True)
        while handle is None and time.monotonic() < until:
            try:
                handle = _locked(path, locks)
            except BlockingIOError:
                time.sleep(_LOOKED_AGAIN_S)
    try:
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                path.unlink(missing_ok=True)
            os.close(handle)


def _mark(target: Path) -> str:
    """How temporary names for a target begin on this machine; the number of the process follows."""
    return f".{target.name}-{sub(r'[^A-Za-z0-9]', '', node())}-"


def _clear_killed(target: Path) -> None:
    """Remove what a process left that was killed while it wrote this target."""
    mark = _mark(target)
    for path in target.parent.iterdir():
        number = path.name.removeprefix(mark).partition("-")[0] if path.name.startswith(mark) else ""
        if not number.isdigit() or not Path("/proc/self").exists() or _is_running(number):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _is_running(number: str) -> bool:
    """Whether a process still does anything: one that was killed stays listed until its parent has asked after it."""
    try:
        _, _, rest = Path(f"/proc/{number}/stat").read_text(encoding="utf-8").rpartition(")")
    except OSError:
        return False
    return rest.split()[0] != "Z"


def unwritable(target: Path, error: OSError) -> PaveTwinError:
    """The plain sentence for a file that could not be written, or for another that was missing while it was."""
    place = target.absolute()
    missing = Path(os.fsdecode(error.filename)).absolute() if error.errno == errno.ENOENT and error.filename else None
    if missing and missing not in (place, *place.parents) and place.parent not in missing.parents:
        return PaveTwinError(f"Cannot write '{target}': '{missing}' is gone. Give the same command again.")
    nowhere = error.errno == errno.ENOENT  # what mkdir says of a place such as /proc
    reason = "nothing can be made there" if nowhere else error.strerror or str(error)
    return PaveTwinError(f"Cannot write '{target}': {reason}. {hint(error, 'choose another folder')}.")


def check_writable(target: Path, otherwise: str = "") -> None:
    """Fail before what takes long, not after it. No folder is created, for the sake of concurrent processes.

    Args:
        otherwise: a sentence behind the message.

    Raises:
        PaveTwinError: no file can be made there.
    """
    place = next(folder for folder in target.absolute().parents if folder.exists())
    try:
        handle, name = tempfile.mkstemp(dir=place, prefix=".writable-")
        os.close(handle)
        Path(name).unlink()
    except OSError as error:
        raise PaveTwinError(" ".join(filter(None, (str(unwritable(target, error)), otherwise)))) from error


def hint(error: OSError, otherwise: str) -> str:
    """What helps, as the beginning of a sentence: room where there is none left, else `otherwise`."""
    return f"Free some space or {otherwise}" if error.errno in NO_ROOM else otherwise[:1].upper() + otherwise[1:]

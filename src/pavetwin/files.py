"""Files written whole or not at all, by a temporary name next to the target that is renamed; hashes and locks."""

import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from platform import node
from re import sub
from typing import TYPE_CHECKING, Any, Final

from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from filelock import BaseFileLock

PICTURE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
"""Suffixes of images that are read, in lower case."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""A full disk, a used-up quota, and a file that may not grow."""

FORMAT: Final = 1
"""The format of every file and folder that PaveTwin writes and reads."""

LOCK_POLL_S: Final = 0.003
"""Interval at which a held lock is tried again."""


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
    """Check, before long work, that files can be written into a folder, which need not exist.

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
    """A temporary folder next to `target`, for files that are whole before they are moved to their places.

    Raises:
        PaveTwinError: it cannot be made, or the block failed to write. The folder is removed in that case.
    """
    try:
        with _temporary_folder(target) as temporary:
            yield temporary
    except OSError as error:
        raise unwritable(target.parent, error) from error


@contextmanager
def _temporary_folder(target: Path) -> Iterator[Path]:
    """A folder next to `target`; removed at the end of the block, unless it was renamed."""
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
    """Keep other processes from working in `folder`, which need not exist, while the block runs.

    A hidden file next to the folder is locked, and removed afterwards.

    Raises:
        PaveTwinError: another process is at work there, or nothing can be written next to the folder.
    """
    from filelock import Timeout

    path = folder.absolute().parent / f".{folder.absolute().name}.lock"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = _acquired(path, 0.0)
    except Timeout as error:
        raise PaveTwinError(
            f"Another process is at work in '{folder}'; wait for its end or choose another folder."
        ) from error
    except OSError as error:
        raise unwritable(path, error) from error
    with _released(lock, path):
        yield


@contextmanager
def file_lock(target: Path, timeout_s: float) -> Iterator[None]:
    """Hold the lock of `target` while the block runs; wait for other processes and threads that hold it.

    The lock is a hidden file next to the target, removed afterwards. If it cannot be created, nothing is locked.

    Args:
        timeout_s: after this time proceed without the lock; its holder may hang.
    """
    from filelock import Timeout

    path = target.with_name(f".{target.name}.lock")
    with ExitStack() as held:
        with suppress(Timeout, OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(_released(_acquired(path, timeout_s), path))
        yield


def _acquired(path: Path, timeout_s: float) -> "BaseFileLock":
    """A lock on a file that this process holds. filelock is imported here: it takes 80 ms."""
    from filelock import FileLock

    lock = FileLock(path, thread_local=False)
    lock.acquire(timeout=timeout_s, poll_interval=LOCK_POLL_S)
    return lock


@contextmanager
def _released(lock: "BaseFileLock", path: Path) -> Iterator[None]:
    """Remove the file of a lock while it is held, then release it."""
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        lock.release()


def _mark(target: Path) -> str:
    """Prefix of temporary names for a target on this machine; the number of the process follows."""
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
        return PaveTwinError(f"Cannot write '{target}': '{missing}' no longer exists. Run the same command again.")
    nowhere = error.errno == errno.ENOENT  # mkdir's answer in a place such as /proc
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
    """The fix, as the beginning of a sentence: free space where there is none, else `otherwise`."""
    return f"Free some space or {otherwise}" if error.errno in NO_ROOM else otherwise[:1].upper() + otherwise[1:]

"""Contents of folders, to compare results byte by byte."""

import hashlib
from pathlib import Path


def contents(folder: Path) -> dict[str, bytes]:
    """The bytes of every file below the folder, by path in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def digests(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file below the folder, by path in it."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents(folder).items()}

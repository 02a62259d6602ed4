"""Images and their label files as they are written into a dataset's folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pavetwin.capture.formats import Format
from pavetwin.capture.record import Record, truth_path
from pavetwin.files import link_or_copy, write_pieces


def write_image(folder: Path, record: Record, picture: bytes, formats: Sequence[Format]) -> list[str]:
    """An image's files, the picture once. Returns their paths in the folder, the record last."""
    labels = {path: content for each in formats for path, content in each.of_image(record).items()}
    files = {**labels, record.image: picture, truth_path(record.split, record.name): record.as_bytes()}
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    return list(files)


def link_image(folder: Path, record: Record, formats: Sequence[Format]) -> None:
    """Link the image into the other folders that formats need it in."""
    for each in formats:
        for path in each.links(record):
            link_or_copy(folder / record.image, folder / path)


def write_over_all(folder: Path, formats: Sequence[Format], splits: tuple[str, ...]) -> None:
    """Write the files that formats have for all images, which must exist."""
    for each in formats:
        for split in splits:
            for path, pieces in each.of_split(folder, split):
                write_pieces(folder / path, pieces)
        for path, content in each.of_all(splits).items():
            write_pieces(folder / path, [content])


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    write_pieces(path, [yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True).encode()])

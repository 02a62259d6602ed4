"""The record of one image on disk: the file beside the image from which every label format is made."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pavetwin.capture.truth import LabelledObject
from pavetwin.errors import PaveTwinError

TRUTH = "truth"
"""Folder of these files, by split."""


@dataclass(frozen=True)
class Record:
    """Everything recorded about one image."""

    index: int
    """Unique in its dataset."""
    name: str
    """Of its files, without suffix, see `pavetwin.capture.names`."""
    split: str
    suffix: str
    """Of the picture, with its dot."""
    size_px: tuple[int, int]
    """Width, height."""
    camera: dict[str, Any]
    light: dict[str, Any]
    traffic: dict[str, Any]
    aim: dict[str, Any]
    """What the image had to show, and at which attempt it did."""
    objects: tuple[LabelledObject, ...]

    @property
    def image(self) -> str:
        """The picture's path in the dataset."""
        return f"images/{self.split}/{self.name}{self.suffix}"

    @property
    def labelled(self) -> tuple[LabelledObject, ...]:
        return tuple(obj for obj in self.objects if obj.ignored is None)

    def as_bytes(self) -> bytes:
        content = {"image": self.image} | {each.name: getattr(self, each.name) for each in fields(self)[:-1]}
        rows = [f" {json.dumps(key)}: {_text(value)},\n" for key, value in content.items()]
        objects = ",\n  ".join(_text(obj.as_dict()) for obj in self.objects)
        return ("{\n" + "".join(rows) + ' "objects": [\n  ' + objects + "\n ]\n}\n").encode()


def _text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def truth_path(split: str, name: str) -> str:
    """Of an image's file in the dataset."""
    return f"{TRUTH}/{split}/{name}.json"


def read_record(path: Path) -> Record:
    """An image's file read back.

    Raises:
        PaveTwinError: it is damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        values = {each.name: content[each.name] for each in fields(Record)}
        width, height = values["size_px"]
        objects = tuple(_labelled_object(each) for each in values["objects"])
        return Record(**values | {"size_px": (width, height), "objects": objects})
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise PaveTwinError(f"'{path}' is damaged or missing; capture into another folder.") from error


def _labelled_object(content: dict[str, Any]) -> LabelledObject:
    return LabelledObject(**content | {"box": tuple(content["box"]), "position_m": tuple(content["position_m"])})


def read_records(folder: Path, split: str | None = None) -> Iterator[Record]:
    """The records of a dataset by name, one in memory at a time; all splits unless one is named."""
    for path in record_paths(folder, split):
        yield read_record(path)


def record_paths(folder: Path, split: str | None = None) -> Sequence[Path]:
    """Their paths, by name."""
    return sorted((folder / TRUTH).glob(f"{split or '*'}/*.json"), key=lambda path: path.name)

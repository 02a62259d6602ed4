"""Records of images on disk, from which every label format is made, and counts over them."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

from pavetwin.capture.settings import FILE, read_description
from pavetwin.capture.truth import LabelledObject
from pavetwin.errors import PaveTwinError
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import categories

TRUTH = "truth"  # Folder of these files, by split


@dataclass(frozen=True)
class Record:
    """Everything recorded about one image."""

    index: int
    """Unique in its dataset."""
    name: str
    """Name of its files, without suffix, see `pavetwin.capture.samples`."""
    split: str
    suffix: str
    """Suffix of the picture, with its dot."""
    size_px: tuple[int, int]
    """Width, height."""
    camera: dict[str, Any]
    light: dict[str, Any]
    traffic: dict[str, Any]
    aim: dict[str, Any]
    """Requirements on the image, and the attempt that met them."""
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
    """Path of an image's record in the dataset."""
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


SIZES: Final = (("small", 32.0), ("medium", 96.0), ("large", float("inf")))
"""COCO's size classes: small below a mask of 32² pixels, medium below 96²."""


@dataclass
class Statistics:
    """Counts over a dataset, by name."""

    classes: tuple[str, ...] = field(default_factory=lambda: tuple(category.name for category in categories()))
    """Names of the classes, by number."""
    images: Counter[str] = field(default_factory=Counter)
    """Keyed by split."""
    platforms: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Images by platform and split."""
    empty: Counter[str] = field(default_factory=Counter)
    """Images that show no defect, by split."""
    missed_requests: int = 0
    """Images that show another class than requested (or a defect where none was): no pose for the request was found."""
    labelled: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Keyed by class and split."""
    distinct: dict[tuple[str, str], set[str]] = field(default_factory=dict)
    """Ids of the labelled defects, by class and split."""
    severities: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled defects by class and severity."""
    sizes: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled objects by class and COCO's size class."""
    ignored: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Keyed by class and reason."""

    def add(self, record: Record) -> None:
        self.images[record.split] += 1
        self.platforms[record.camera["platform"], record.split] += 1
        self.empty[record.split] += not any("severity" in obj.details for obj in record.objects)
        self.missed_requests += record.aim["requested"] != record.aim["met"]
        for obj in record.objects:
            if obj.ignored is not None:
                self.ignored[obj.category, obj.ignored] += 1
                continue
            self.labelled[obj.category, record.split] += 1
            self.sizes[obj.category, _size(obj.area_px)] += 1
            if "severity" in obj.details:
                self.severities[obj.category, obj.details["severity"]] += 1
                self.distinct.setdefault((obj.category, record.split), set()).add(obj.id)

    @property
    def platform_names(self) -> list[str]:
        return sorted({name for name, _ in self.platforms})

    def missing_classes(self) -> dict[str, list[str]]:
        """Split → the classes without a label in it that another split has labels of."""
        labelled = [name for name in self.classes if any(self.labelled[name, split] for split in SPLITS)]
        lacking = {split: [name for name in labelled if not self.labelled[name, split]] for split in self.images}
        return {split: lacking[split] for split in SPLITS if lacking.get(split)}

    def as_dict(self) -> dict[str, Any]:
        """Counts for the manifest, without empty entries."""
        names, splits = self.classes, [split for split in SPLITS if self.images[split]]
        distinct = {name: {split: len(self.distinct.get((name, split), ())) for split in splits} for name in names}
        return {
            "images": {split: self.images[split] for split in splits},
            "images_by_platform": {name: _row(self.platforms, name) for name in self.platform_names},
            "images_without_defects": {split: self.empty[split] for split in splits},
            "images_not_as_requested": self.missed_requests,
            "labels": {name: {split: self.labelled[name, split] for split in splits} for name in names},
            "distinct_defects": {
                name: {split: found for split, found in row.items() if found}
                for name, row in distinct.items()
                if any(row.values())
            },
            "ignored": {name: row for name in names if (row := _row(self.ignored, name))},
        }


def count(folder: Path) -> Statistics:
    """The counts of a dataset; one image in memory at a time.

    Raises:
        PaveTwinError: a record is damaged.
    """
    classes = read_description(folder)["classes"] if (folder / FILE).is_file() else None
    return counted(read_records(folder), classes)


def counted(records: Iterable[Record], classes: Iterable[str] | None = None) -> Statistics:
    """The counts of images.

    Args:
        classes: of the dataset's labels, by number; those that are registered when not given.
    """
    statistics = Statistics() if classes is None else Statistics(classes=tuple(classes))
    for record in records:
        statistics.add(record)
    return statistics


def _size(area_px: int) -> str:
    return next(name for name, side in SIZES if area_px < side**2)


def _row(counter: Counter[tuple[str, str]], name: str) -> dict[str, int]:
    return {key: counter[first, key] for first, key in sorted(counter) if first == name}

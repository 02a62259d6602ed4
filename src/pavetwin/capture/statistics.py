"""What is in a dataset, counted from its records."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pavetwin.capture.record import Record, read_records
from pavetwin.capture.settings import FILE, read_description
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import categories

SIZES: Final = (("small", 32.0), ("medium", 96.0), ("large", float("inf")))
"""COCO's size classes: small below a mask of 32² pixels, medium below 96²."""


@dataclass
class Statistics:
    """Counts over a dataset, by name."""

    classes: tuple[str, ...] = field(default_factory=lambda: tuple(category.name for category in categories()))
    """Of labels, by number."""
    images: Counter[str] = field(default_factory=Counter)
    """By split."""
    platforms: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Images by platform and split."""
    empty: Counter[str] = field(default_factory=Counter)
    """Images that show no defect, by split."""
    missed_requests: int = 0
    """Images that show another class than requested (or a defect where none was): no pose for the request was found."""
    labelled: Counter[tuple[str, str]] = field(default_factory=Counter)
    """By class and split."""
    distinct: dict[tuple[str, str], set[str]] = field(default_factory=dict)
    """Ids of the labelled defects, by class and split."""
    severities: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled defects by class and severity."""
    sizes: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled objects by class and COCO's size class."""
    ignored: Counter[tuple[str, str]] = field(default_factory=Counter)
    """By class and reason."""

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
        """As the manifest holds it, without empty entries."""
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
    classes = read_description(folder).get("classes") if (folder / FILE).is_file() else None
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

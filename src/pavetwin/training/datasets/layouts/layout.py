"""Interface of layouts: raw images, with the classes of the source."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pavetwin.config.settings import Settings
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.common_form import Polygon
from pavetwin.training.datasets.pictures import PictureIndex
from pavetwin.training.datasets.report import Finding, Report

NOT_PAIRED: Final = "labels without a picture"
SWAPPED: Final = "the corners of a box were swapped; put in order"


@dataclass(frozen=True, slots=True)
class RawObject:
    """One object as a label file has it."""

    label: str
    """Its class in the source's words."""
    box: FloatBox
    """Left, top, right, bottom; right and bottom are exclusive. In pixels, or in shares of the image."""
    line: int | None = None
    """Line in the label file."""
    outline: Polygon | None = None
    """In the same unit."""
    ignored: str | None = None
    """Reason for which the source itself excludes it; None for a label."""
    attributes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RawImage:
    """One picture and its objects, nothing of it checked yet."""

    picture: Path
    original: str
    """The picture's path in the source's folder."""
    labels: str
    """The label file's path there; the picture's where it has none."""
    objects: tuple[RawObject, ...] = ()
    is_normalised: bool = False
    """True if boxes and outlines are shares of the image."""
    size_px: tuple[int, int] | None = None
    """Width, height of the picture that the labels were made for; None if not stated."""
    line: int | None = None
    """Line of the image, or else of its size, in the label file."""
    gsd_mm: float | None = None
    group: str | None = None
    is_background: bool = False
    """The source verified that it shows nothing of any class."""
    attributes: Mapping[str, str] = field(default_factory=dict)


class LabelLayout(Settings):
    """A layout of label files; its settings may be given in a mapping file."""

    @abstractmethod
    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        """The images that have labels, then those that have none, in an order that depends on names alone.

        Unreadable files are left out and reported.
        """


def paired(pictures: PictureIndex, labels: str, stem: str, report: Report) -> str | None:
    """The picture of a label file; None, and a line in the report, where there is none or more than one."""
    found = pictures.find(labels, stem)
    if not found:
        report.add(Finding.NOTE, labels, "there is no picture of this name; left out", alike=NOT_PAIRED)
        return None
    if len(found) > 1:
        report.add(Finding.REFUSED, labels, f"two files of one name, {found[0]} and {found[1]}; both are left out")
        return None
    return found[0]


def unlabelled(folder: Path, pictures: PictureIndex) -> Iterator[RawImage]:
    """The pictures that no label file belongs to: only a list of verified background makes anything of them."""
    for name in pictures.unused:
        yield RawImage(folder / name, name, name)

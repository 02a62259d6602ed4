"""Pascal VOC: one XML file an image. Boxes count pixels from 1 and include their last, as its development kit does."""

from collections.abc import Iterator
from math import isfinite, nan
from pathlib import Path, PurePosixPath
from typing import Literal

from pydantic import Field

from pavetwin.labels.voc import Element, XmlError, parse_xml
from pavetwin.training.datasets.layouts.layout import SWAPPED, LabelLayout, RawImage, RawObject, paired, unlabelled
from pavetwin.training.datasets.pictures import PictureIndex, files_in, inside
from pavetwin.training.datasets.report import Finding, Report


class VocLayout(LabelLayout):
    """Pictures and labels are paired by their names, not by `<filename>`, which datasets on the web often get wrong."""

    format: Literal["voc"] = "voc"
    first_pixel: Literal[0, 1] = Field(default=1, description="The number of the first column and row.")
    ending: str = Field(default="", description="Ending of the names of label files after the picture's name.")

    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        pictures = PictureIndex(folder)
        for labels in files_in(folder, frozenset({".xml"})):
            stem = PurePosixPath(labels).stem.removesuffix(self.ending)
            picture = paired(pictures, labels, stem, report)
            if picture is None:
                continue
            try:
                root = parse_xml(folder / labels)
                _check_filename(folder, root)
                objects = tuple(self._object(each, labels, report) for each in root.all("object"))
                size_px = _size(root)
            except XmlError as error:
                report.add(Finding.REFUSED, labels, f"{error}; the image is left out", error.line)
                continue
            yield RawImage(folder / picture, picture, labels, objects, size_px=size_px, line=_line(root.find("size")))
        yield from unlabelled(folder, pictures)

    def _object(self, node: Element, labels: str, report: Report) -> RawObject:
        named, corners = node.find("name"), node.find("bndbox")
        label = node.value("name")
        if named is None or label is None:
            raise XmlError("an object has no name", node.line)
        if corners is None:
            raise XmlError(f"'{label}' has no bndbox", node.line)
        x_min, y_min, x_max, y_max = (_number(corners, tag) for tag in ("xmin", "ymin", "xmax", "ymax"))
        if x_min > x_max or y_min > y_max:
            report.add(Finding.REPAIRED, labels, SWAPPED, corners.line)
            x_min, x_max = sorted((x_min, x_max))
            y_min, y_max = sorted((y_min, y_max))
        before, beyond = -self.first_pixel, 1 - self.first_pixel
        box = (x_min + before, y_min + before, x_max + beyond, y_max + beyond)
        ignored = "difficult" if node.value("difficult") == "1" else None
        return RawObject(label, box, named.line, ignored=ignored)


def _number(node: Element, tag: str) -> float:
    """The finite number in a child of that name.

    Raises:
        XmlError: there is none.
    """
    child, text = node.find(tag), node.value(tag)
    try:
        value = float(text or "")
    except ValueError:
        value = nan
    if not isfinite(value):
        line = child.line if child is not None else node.line
        raise XmlError(f"{tag} is {text!r}, which is not a number" if text else f"{tag} is missing", line)
    return value


def _size(root: Element) -> tuple[int, int] | None:
    """Width and height as the file has them, in whichever order; None where it has none."""
    node = root.find("size")
    if node is None or not (node.value("width") and node.value("height")):
        return None
    width, height = _number(node, "width"), _number(node, "height")
    return (round(width), round(height)) if width > 0 and height > 0 else None


def _line(node: Element | None) -> int | None:
    return node.line if node is not None else None


def _check_filename(folder: Path, root: Element) -> None:
    """A name that leads out of the folder is a sign of a file that is not to be trusted.

    Raises:
        XmlError: it does.
    """
    node, name = root.find("filename"), root.value("filename")
    if node is not None and name is not None and inside(folder, name) is None:
        raise XmlError(f"filename '{name}' leads out of the folder", node.line)

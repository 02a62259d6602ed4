"""Pascal VOC: `voc/Annotations/NAME.xml`, `voc/JPEGImages` with the pictures, `voc/ImageSets/Main/SPLIT.txt`.

Boxes count pixels from 1 and include their last, as in the VOC development kit. Ignored objects are marked
`difficult`, which VOC's own evaluation leaves out.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

from pavetwin.capture.formats.base import Format, label_format
from pavetwin.capture.record import Record, record_paths
from pavetwin.capture.truth import LabelledObject

OCCLUDED = 0.95
"""A visible fraction below this is an occlusion in VOC's sense: more than about 5 % of the box is covered."""


@label_format("voc")
class Voc(Format):
    def of_image(self, record: Record) -> Mapping[str, bytes]:
        root = ElementTree.Element("annotation")
        _texts(root, folder="JPEGImages", filename=f"{record.name}{record.suffix}")
        _texts(ElementTree.SubElement(root, "source"), database="PaveTwin", annotation="PaveTwin", image="rendered")
        width, height = record.size_px
        _texts(ElementTree.SubElement(root, "size"), width=width, height=height, depth=3)
        _texts(root, segmented=0)
        for obj in record.objects:
            _add(root, obj)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode") + "\n"
        return {f"voc/Annotations/{record.name}.xml": text.encode()}

    def links(self, record: Record) -> tuple[str, ...]:
        return (f"voc/JPEGImages/{record.name}{record.suffix}",)

    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        names = (f"{path.stem}\n".encode() for path in record_paths(folder, split))
        yield f"voc/ImageSets/Main/{split}.txt", names


def _add(root: ElementTree.Element, obj: LabelledObject) -> None:
    node = ElementTree.SubElement(root, "object")
    _texts(
        node,
        name=obj.category,
        pose="Unspecified",
        truncated=int(obj.truncated),
        occluded=int(obj.visible_fraction < OCCLUDED),
        difficult=int(obj.ignored is not None),
    )
    left, top, right, bottom = obj.box
    _texts(ElementTree.SubElement(node, "bndbox"), xmin=left + 1, ymin=top + 1, xmax=right, ymax=bottom)
    extras = {"id": obj.id, "visible_fraction": obj.visible_fraction, "distance_m": obj.distance_m, **obj.details}
    _texts(ElementTree.SubElement(node, "pavetwin"), **extras | ({"ignored": obj.ignored} if obj.ignored else {}))


def _texts(node: ElementTree.Element, **values: object) -> None:
    for name, value in values.items():
        if value is not None:
            ElementTree.SubElement(node, name).text = str(value)

"""What a format of labels is, and where formats are registered."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from pavetwin.capture.record import Record
from pavetwin.registry import Registry


class Format:
    """One format of labels: files for each image, written with it, and files for a whole split or dataset, written
    last. A format defines those that it has."""

    def of_image(self, record: Record) -> Mapping[str, bytes]:
        """The files of one image: path in the dataset → content."""
        del record
        return {}

    def links(self, record: Record) -> tuple[str, ...]:
        """Where else in the dataset the picture must lie for the format's tools."""
        del record
        return ()

    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        """The files for one split's images: path in the dataset, content in pieces.

        Args:
            folder: the dataset, whose images are all there.
        """
        del folder, split
        return iter(())

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        """The files for the whole dataset."""
        del splits
        return {}


FORMATS: Registry[type[Format]] = Registry(
    "label format", key="formats", group="pavetwin.formats", home="pavetwin.capture.formats"
)
label_format = FORMATS.register
"""Register a format under a name, which `formats` then takes."""


def find_formats(names: tuple[str, ...]) -> list[Format]:
    """The formats of these names.

    Raises:
        PaveTwinError: there is no such format; the message names the nearest.
    """
    return [FORMATS.get(name)() for name in dict.fromkeys(names)]

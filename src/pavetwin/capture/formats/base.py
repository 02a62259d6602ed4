"""What a format of labels is, and where formats are registered."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from pavetwin.capture.record import Record
from pavetwin.errors import PaveTwinError, nearest_name


class Format(ABC):
    """Label files of one kind: some an image, written with it, and some over all, written at the end."""

    name: str = ""

    @abstractmethod
    def of_image(self, record: Record) -> Mapping[str, bytes]:
        """The files of one image: path in the dataset → content."""

    def links(self, record: Record) -> tuple[str, ...]:
        """Where else in the dataset the picture must lie for the format's tools."""
        del record
        return ()

    @abstractmethod
    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        """The files over one split's images: path in the dataset, content piece by piece.

        Args:
            folder: the dataset, whose images are all there.
        """

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        """The files over the whole dataset."""
        del splits
        return {}


_FORMATS: Final[dict[str, type[Format]]] = {}


def label_format(name: str) -> Callable[[type[Format]], type[Format]]:
    """Register a format under `name`, which `--formats` then takes."""

    def register(kind: type[Format]) -> type[Format]:
        if name in _FORMATS:
            raise ValueError(f"a format '{name}' is registered already")
        kind.name = name
        _FORMATS[name] = kind
        return kind

    return register


def find_formats(names: tuple[str, ...]) -> list[Format]:
    """The formats of these names.

    Raises:
        PaveTwinError: there is no such format; the message names the nearest.
    """
    for name in names:
        if name not in _FORMATS:
            near = nearest_name(name, _FORMATS) or f"; there are {', '.join(_FORMATS)}"
            raise PaveTwinError(f"--formats: no format '{name}'{near}.")
    return [_FORMATS[name]() for name in dict.fromkeys(names)]

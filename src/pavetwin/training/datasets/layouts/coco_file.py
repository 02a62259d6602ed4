"""A COCO file read entry by entry: memory holds one image with its annotations, however large the file is.

COCO lists annotations in any order, often far from their image. So a file is read once from the beginning to the end:
the text of every image and annotation is put into a temporary file, and only where it begins is kept. Then each image
is read back with its annotations.
"""

import json
import tempfile
from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

CHUNK: Final = 1 << 20
"""Characters that are read at a time."""

LARGEST: Final = 1 << 28
"""Characters of one entry, at most."""

_MOST_OTHERS: Final = 1000

_UNDECIDED: Final = 2
"""Characters of a number that it may have beyond a shorter one: `.`, `e+`."""

MOST_DIGITS: Final = 300
"""Of a whole number; one of more is beyond what a float holds, and is read as infinite."""

LISTS: Final = ("categories", "images", "annotations")
"""What a COCO file has, one list each."""


class CocoFileError(ValueError):
    """A file is not JSON; the message says why."""

    def __init__(self, words: str, line: int) -> None:
        super().__init__(words)
        self.line = line


@dataclass(frozen=True, slots=True)
class CocoEntry:
    """One object of a list of the file."""

    content: dict[str, Any]
    line: int
    """Where it begins, from 1."""


class CocoFile:
    """The entries of a file that was read once."""

    def __init__(self, entries: IO[bytes]) -> None:
        self._entries = entries
        self.categories: list[dict[str, Any]] = []
        self._images: list[tuple[str, object, int, int]] = []
        """`file_name`, id, where its text begins, and its line."""
        self._annotations: dict[object, array[int]] = {}
        """By id of the image: of each in turn where its text begins, and its line."""
        self.lists: set[str] = set()
        """Those of `LISTS` that the file has."""
        self.others: list[int] = []
        """Lines of the entries of its lists that are no objects; the first thousand."""

    def add(self, key: str, content: Any, text: str, line: int) -> None:
        """Take up an entry of one of the file's lists, its text and its line."""
        if not isinstance(content, dict):
            if len(self.others) < _MOST_OTHERS:
                self.others.append(line)
            return
        if key == "categories":
            self.categories.append(content)
            return
        begins = self._entries.tell()
        self._entries.write(text.encode().replace(b"\n", b" ") + b"\n")
        if key == "images":
            self._images.append((str(content.get("file_name")), as_id(content.get("id")), begins, line))
        else:
            self._annotations.setdefault(as_id(content.get("image_id")), array("q")).extend((begins, line))

    def images(self) -> Iterator[tuple[CocoEntry, list[CocoEntry]]]:
        """Every image with its annotations, by `file_name`, the annotations in the file's order."""
        for _, number, begins, line in sorted(self._images, key=lambda image: image[0]):
            places = self._annotations.get(number, array("q"))
            annotations = [self._entry(*place) for place in zip(places[::2], places[1::2], strict=True)]
            yield self._entry(begins, line), annotations

    def repeated_ids(self) -> frozenset[object]:
        """The ids that several images have, or that are none: whose annotations are whose is not known."""
        counts = Counter(number for _, number, _, _ in self._images)
        return frozenset({None, *(number for number, count in counts.items() if count > 1)})

    def stray_lines(self) -> Iterator[int]:
        """The lines of annotations of images that are not listed."""
        known = {number for _, number, _, _ in self._images}
        for number, places in self._annotations.items():
            if number not in known:
                yield from places[1::2]

    def _entry(self, begins: int, line: int) -> CocoEntry:
        self._entries.seek(begins)
        return CocoEntry(_DECODER.decode(self._entries.readline().decode()), line)


def _whole(digits: str) -> int | float:
    """A whole number; Python reads one of thousands of digits slowly, or refuses to."""
    return int(digits) if len(digits) <= MOST_DIGITS else float(digits)


_DECODER: Final = json.JSONDecoder(parse_int=_whole)


def as_id(value: object) -> object:
    """An id as it may be compared: lists and the like are none."""
    return value if isinstance(value, int | str) and not isinstance(value, bool) else None


@contextmanager
def coco_file(path: Path) -> Iterator[CocoFile | None]:
    """A file's entries while the block runs; None for a JSON file that has none of COCO's lists.

    Raises:
        CocoFileError: it is not JSON.
        OSError, UnicodeDecodeError, RecursionError: it cannot be read.
    """
    with path.open(encoding="utf-8-sig") as stream, tempfile.TemporaryFile() as entries:
        found, scanner = CocoFile(entries), _Scanner(stream)
        for key, entry in scanner.entries():
            if key in LISTS:
                found.lists.add(key)
                if entry is not None:
                    found.add(key, *entry)
        yield found if found.lists else None


class _Scanner:
    """Reads the lists of a JSON object entry by entry."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._text, self._at = "", 0
        self._line, self._counted = 1, 0
        """The line of this place in the text, which is not behind `_at`."""

    def entries(self) -> Iterator[tuple[str, tuple[Any, str, int] | None]]:
        """Of every entry of a list: the list's key; content, text and line; of a list first its key alone."""
        if self._next() == "[":  # of a list as the whole, no entry is wanted
            for _ in self._list(""):
                pass
        elif self._next() == "{":
            yield from self._lists()
        else:
            self._value()
        if self._next():
            raise self._error("Extra data")

    def _lists(self) -> Iterator[tuple[str, tuple[Any, str, int] | None]]:
        self._take("{")
        while self._next() != "}":
            key, _, _ = self._value()
            self._take(":")
            if self._next() != "[":
                self._value()
            else:
                yield str(key), None
                yield from self._list(str(key))
            if self._next() != "}":
                self._take(",")
        self._take("}")

    def _list(self, key: str) -> Iterator[tuple[str, tuple[Any, str, int]]]:
        self._take("[")
        while self._next() != "]":
            yield key, self._value()
            if self._next() != "]":
                self._take(",")
                if self._next() == "]":
                    raise self._error("Expecting value")
        self._take("]")

    def _next(self) -> str:
        """The next character that is not space; empty at the end."""
        while True:
            while self._at < len(self._text) and self._text[self._at].isspace():
                self._at += 1
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more(CHUNK):
                return ""

    def _take(self, character: str) -> None:
        if self._next() != character:
            raise self._error(f"Expecting '{character}' delimiter")
        self._at += 1

    def _value(self) -> tuple[Any, str, int]:
        """The next value, its text and its line."""
        self._next()
        self._count()
        line, size = self._line, CHUNK
        while True:
            try:
                content, end = _DECODER.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                if not self._more(size):
                    raise self._error(error.msg, error.pos) from error
            else:
                # A number near the end of what was read may go on (`1e+` is read as 1).
                if end + _UNDECIDED < len(self._text) or not self._more(size):
                    text, self._at = self._text[self._at : end], end
                    return content, text, line
            size = min(2 * len(self._text), LARGEST)
            if len(self._text) - self._at > LARGEST:
                raise self._error(f"one entry has more than {LARGEST // 10**6} million characters")

    def _more(self, size: int) -> bool:
        """Whether there was more to read."""
        chunk = self._stream.read(size)
        if not chunk:
            return False
        self._count()
        self._text, self._at, self._counted = self._text[self._at :] + chunk, 0, 0
        return True

    def _count(self) -> None:
        """Count lines up to where the reader is."""
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at

    def _error(self, words: str, at: int | None = None) -> CocoFileError:
        end = self._at if at is None else at
        return CocoFileError(words, self._line + self._text.count("\n", self._counted, end))

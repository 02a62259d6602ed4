"""Report of problems found in a dataset and their outcome, with file and line number."""

import csv
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from pavetwin.files import writing

FILE: Final = "report.csv"

UNLABELLED: Final = "unlabelled.txt"
"""List of the pictures without a label, as `--background` takes it."""

MOST: Final = 20_000  # Lines that are kept; more are only counted, so that memory does not grow with the dataset
LONGEST: Final = 400  # Characters of a finding's words: names and classes in files of others may be of any length


class Finding(StrEnum):
    """Outcome of a problem."""

    REFUSED = "refused"
    """A file or an image is left out because it cannot be read as what it claims to be."""
    REPAIRED = "repaired"
    """A box was changed by a documented rule."""
    DROPPED = "dropped"
    """A box or an image is left out by a documented rule."""
    NOTE = "note"
    """Something that may surprise, such as labels whose pictures are not there."""


@dataclass(slots=True)
class Problem:
    """One line of the report."""

    finding: Finding
    file: str
    """Path in the source's folder, with slashes."""
    line: int | None
    text: str
    count: int = 1
    """Number of occurrences, the first one here."""

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        again = f" ({self.count} times)" if self.count > 1 else ""
        return f"{place}: {self.text}{again}"


class Report:
    """All that was found."""

    def __init__(self) -> None:
        self._problems: dict[object, Problem] = {}
        self.counts: Counter[Finding] = Counter()
        self.unlabelled: list[str] = []
        """Pictures that are left out since nothing of any class is labelled, also nothing to ignore and no box that is
        not valid, and they are not listed as background."""

    def add(self, finding: Finding, file: str, text: str, line: int | None = None, *, alike: str | None = None) -> None:
        """Add a finding.

        Args:
            alike: what is found again under this key is counted with the first, and has no line of its own.
        """
        self.counts[finding] += 1
        text = text if len(text) <= LONGEST else f"{text[: LONGEST // 2]}…{text[-LONGEST // 2 :]}"
        key: object = (finding, alike) if alike is not None else len(self._problems)
        if (known := self._problems.get(key)) is not None:
            known.count += 1
        elif len(self._problems) < MOST:
            self._problems[key] = Problem(finding, file, line, text)

    @property
    def has_refusals(self) -> bool:
        return self.counts[Finding.REFUSED] > 0

    @property
    def unlisted(self) -> int:
        """Number of findings without a line of their own, because of `MOST`."""
        return self.counts.total() - sum(problem.count for problem in self._problems.values())

    def __iter__(self) -> Iterator[Problem]:
        return iter(self._problems.values())

    @classmethod
    def load(cls, path: Path) -> "Report | None":
        """Read a table of `save`; None if there is none, or it may be incomplete."""
        report = cls()
        try:
            with path.open(encoding="utf-8", newline="") as stream:
                for key, row in enumerate(csv.DictReader(stream)):
                    line = int(row["line"]) if row["line"] else None
                    each = Problem(Finding(row["finding"]), row["file"], line, row["text"], int(row["count"]))
                    report._problems[key] = each
                    report.counts[each.finding] += each.count
        except (OSError, ValueError, KeyError):
            return None
        return report if len(report._problems) < MOST else None

    def save(self, path: Path) -> None:
        """Write it as a table, one finding a row."""
        with (
            writing(path) as temporary,
            # Names of files need not be text on every system.
            temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream,
        ):
            table = csv.writer(stream, lineterminator="\n")
            table.writerow(("finding", "file", "line", "count", "text"))
            for each in self:
                table.writerow((each.finding.value, each.file, each.line or "", each.count, each.text))

    def save_unlabelled(self, path: Path) -> None:
        """Write the list of pictures without a label, one a line; no file where there are none."""
        if not self.unlabelled:
            path.unlink(missing_ok=True)
            return
        lines = "".join(f"{picture}\n" for picture in self.unlabelled)
        with writing(path) as temporary:
            temporary.write_text(lines, encoding="utf-8", errors="surrogateescape")

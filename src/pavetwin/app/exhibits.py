"""Studies and datasets on the page: the kinds of folders, and what a task process shows of them.

A study shows its report, a dataset its contact sheet, made by the command line's functions into the session's folder;
the folders themselves are only read.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from hashlib import sha256
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError

_MARKS: Final = {"design.yaml": "study", "capture.yaml": "captured", "dataset.yaml": "photographs"}
"""The file that a folder of each kind has."""

REPORT: Final = "report.html"
SHEET: Final = "contact-sheet.jpg"


class ExhibitKind(StrEnum):
    STUDY = "study"
    CAPTURED = "captured"
    """A dataset that was captured of worlds."""
    PHOTOGRAPHS = "photographs"
    """One in the common form, imported or made of others."""

    @property
    def file(self) -> str:
        """Name of the shown file."""
        return REPORT if self is ExhibitKind.STUDY else SHEET


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A study or a dataset that the page may name."""

    id: str
    folder: Path
    kind: ExhibitKind


def exhibit_kind(folder: Path) -> ExhibitKind | None:
    """Kind of a folder; None if it is neither a study nor a dataset."""
    return next((ExhibitKind(kind) for mark, kind in _MARKS.items() if (folder / mark).is_file()), None)


def show_exhibit(folder: Path, kind: ExhibitKind, place: Path, report: Callable[[float, str], None]) -> dict[str, str]:
    """Make the report of a study or the contact sheet of a dataset in its present state.

    Args:
        place: the session's folder, where it is kept until the exhibit changes.

    Returns:
        `key`, which names the exhibit as it is, and `file`.

    Raises:
        PaveTwinError: the folder is damaged, or holds nothing yet.
    """
    from pavetwin.app.session_cache import made_once  # here: the server, which imports this module, loads no world

    key = sha256("\n".join(_state(folder)).encode()).hexdigest()[:20]
    target = place / f"exhibit-{key}"
    if not (target / kind.file).is_file():
        with made_once(target) as made:
            _make(folder, kind, made, report)
    return {"key": key, "file": kind.file}


def _make(folder: Path, kind: ExhibitKind, place: Path, report: Callable[[float, str], None]) -> None:
    if kind is ExhibitKind.STUDY:
        from pavetwin.experiments.report.page import write_report
        from pavetwin.experiments.report.study import gather_folder
        from pavetwin.experiments.store import Store

        report(0.0, "Statistics")
        study = gather_folder(Store(folder))
        write_report(study, place, lambda share: report(share, "Drawing the report"))
        return
    report(0.0, "Drawing the contact sheet")
    if kind is ExhibitKind.CAPTURED:
        from pavetwin.capture.sheets import save_sheet

        save_sheet(folder, place / SHEET)
    else:
        from pavetwin.draw.contact_sheet import save_dataset_sheet

        save_dataset_sheet(folder, place / SHEET)


def _state(folder: Path) -> Iterator[str]:
    """Names, sizes and times of what an exhibit is made from."""
    yield str(folder)
    try:
        for path in sorted(folder.rglob("*")):
            stat = path.stat()
            yield f"{path.relative_to(folder)} {stat.st_size} {stat.st_mtime_ns}"
    except OSError as error:
        raise PaveTwinError(f"'{folder}' cannot be read: {error.strerror or error}.") from error

"""Writes an evaluation's report: a page, its figures, and the numbers as JSON and CSV."""

import json
from pathlib import Path
from typing import Any

from pavetwin.files import writing
from pavetwin.reports.blocks import Section
from pavetwin.reports.page import block_numbers, figure_files, render
from pavetwin.reports.words import counted
from pavetwin.training.evaluation.evaluate import DetectorEvaluation, PairedComparison
from pavetwin.training.evaluation.matching import HALF
from pavetwin.training.evaluation.tables import as_values, csv_files, intervals_as_values, runs_as_values
from pavetwin.training.report.sections import percent, sections_of

PAGE = "report.html"


def write_detector_report(
    found: DetectorEvaluation,
    folder: Path,
    *,
    title: str,
    differences: PairedComparison | None = None,
) -> list[Path]:
    """Write `report.html`, `metrics.json`, CSV files and `figures/` into a folder.

    Args:
        title: of the page, such as the name of the file of detections.
        differences: to the detections of another recipe in the same split.

    Returns:
        The files.

    Raises:
        PaveTwinError: a picture of the dataset cannot be read, or a file cannot be written.
    """
    sections = sections_of(found, differences)
    values: dict[str, Any] = as_values(found)
    if differences is not None:
        values["differences"] = intervals_as_values(differences.differences)
        values["runs"] = {"these": runs_as_values(differences.second), "others": runs_as_values(differences.first)}
    files = {
        PAGE: _page(found, sections, title).encode(),
        "metrics.json": (json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(),
    }
    files |= {name: content.encode() for name, content in csv_files(found).items()}
    files |= figure_files(sections)
    for name, content in files.items():
        with writing(folder / name) as temporary:
            temporary.write_bytes(content)
    return [folder / name for name in files]


def _page(found: DetectorEvaluation, sections: list[Section], title: str) -> str:
    return render(
        "pavetwin.training.report",
        "detector.html.jinja",
        title=title,
        question=_question(found),
        facts=_facts(found),
        sections=sections,
        numbers=block_numbers(sections),
    )


def _question(found: DetectorEvaluation) -> str:
    images = counted(len(found.split.images), "image")
    empty = sum(not image.regions for image in found.split.images)
    objects = sum(each.objects for each in found.five.classes)
    left = ""
    if found.unlabelled:
        left = (
            f" {counted(found.unlabelled, 'detection')} of classes that an image's source does not label are left out."
        )
    return (
        f"{counted(found.told, 'detection')} in {images} of the split {found.split.name}, {empty} of them without any "
        f"object, against {counted(objects, 'labelled object')}.{left}"
    )


def _facts(found: DetectorEvaluation) -> list[tuple[str, str]]:
    values = {
        "mAP@0.5": found.five.mean_precision(HALF),
        "mAP@0.5:0.95": found.five.mean_precision(),
        f"Macro F1 at {found.at_stated.confidence:g}": found.at_stated.f1,
        "Coarse mAP@0.5": found.coarse.mean_precision(HALF),
        "Subtype F1, matched": found.subtypes_matched.macro_f1,
    }
    return [(name, f"{percent(value)} %".replace("– %", "–")) for name, value in values.items()]

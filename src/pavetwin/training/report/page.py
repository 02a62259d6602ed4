"""Report of an evaluation: a page, its figures and tables, and the numbers as JSON and CSV."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pavetwin.files import writing
from pavetwin.labels.class_names import SUBTYPE_LABELS
from pavetwin.reports.blocks import Block, Section, Table, TableCell, text_cells
from pavetwin.reports.page import block_numbers, figure_files, render
from pavetwin.reports.words import counted
from pavetwin.training.evaluation.evaluate import DetectorEvaluation, PairedComparison
from pavetwin.training.evaluation.matching import HALF
from pavetwin.training.evaluation.scores import SubtypeScores
from pavetwin.training.evaluation.tables import as_values, csv_files, intervals_as_values, runs_as_values
from pavetwin.training.report import figures, worst

METRICS: Mapping[str, str] = {
    "map50": "mAP@0.5",
    "map50_95": "mAP@0.5:0.95",
    "coarse_map50": "coarse mAP@0.5",
    "f1": "macro F1",
    "precision": "macro precision",
    "recall": "macro recall",
}
"""Name → words, of those that have one value for all classes."""


def percent(value: float | None) -> str:
    """A share as per cent; a dash where it is undefined."""
    return "–" if value is None or value != value else f"{100 * value:.1f}"


def sections_of(found: DetectorEvaluation, differences: PairedComparison | None) -> list[Section]:
    """Sections of the page.

    Raises:
        PaveTwinError: a picture of the dataset cannot be read.
    """
    # Before the figures are drawn: a picture may be missing.
    errors = _errors(found)
    builders: list[Callable[[], Section]] = [
        lambda: Section("metrics", "Metrics", [metrics_table(found)]),
        lambda: Section("differences", "Against the other detections", _differences(differences)),
        lambda: Section("classes", "Classes", [class_table(found), figures.precision_figure(found)]),
        lambda: Section("confusion", "What is taken for what", _confusion(found)),
        lambda: Section("conditions", "By conditions and objects", _conditions(found)),
        lambda: Section("confidence", "Confidences", [figures.calibration_figure(found), _calibration_words(found)]),
        lambda: Section("sizes", "Sizes and severities", [*_sizes(found), *_severities(found)]),
        lambda: Section("errors", "The worst errors", errors),
    ]
    return [section for build in builders if not (section := build()).empty]


def metrics_table(found: DetectorEvaluation) -> Table:
    rows = [
        (*text_cells(words, percent(each.value)), TableCell(_interval(each.low, each.high)))
        for name, words in METRICS.items()
        for each in [found.intervals[name]]
    ]
    for words, scores in (("matched", found.subtypes_matched), ("true", found.subtypes_true)):
        if scores is not None:
            rows.append(text_cells(f"subtype macro F1 on {words} regions", percent(scores.macro_f1), ""))
    if (best := found.at_best) is not None:
        at_best = f"at confidence {best.confidence:.3f}, best of the validation split"
        rows += [
            text_cells(f"{words} {at_best}", percent(value), "")
            for words, value in (
                ("macro F1", best.f1),
                ("macro precision", best.precision),
                ("macro recall", best.recall),
            )
        ]
    rows.append(text_cells("expected calibration error", percent(found.reliability_in_use.error), ""))
    at = found.at_stated.confidence
    return Table(
        "In per cent, with 95 % bootstrap intervals over images.",
        ("metric", "value", "interval"),
        tuple(rows),
        lead=1,
        notes=[
            f"Precision, recall, F1 and the calibration error are those of detections from confidence {at:g} on, at "
            "IoU 0.5. Means are over the classes that have objects."
        ],
    )


def _interval(low: float, high: float) -> str:
    return "" if low != low else f"{100 * low:.1f} – {100 * high:.1f}"


def _differences(found: PairedComparison | None) -> list[Block]:
    if found is None:
        return []
    rows = tuple(
        text_cells(
            METRICS.get(name, name.replace("ap50 ", "AP@0.5 ")),
            *(" · ".join(percent(run[name]) for run in of) for of in (found.second, found.first)),
            f"{100 * each.value:+.1f}",
            _interval(each.low, each.high),
            "" if each.p != each.p else f"{each.p:.3f}",
        )
        for name, each in found.differences.items()
        if each.value == each.value
    )
    several = len(found.second) + len(found.first) > 2
    what = "images and runs, each run with its own seed" if several else "images"
    return [
        Table(
            "These detections and the others in per cent, and what they differ by in percentage points"
            f"{' on the mean' if several else ''}, with 95 % intervals of a paired bootstrap over {what}.",
            ("metric", "these", "others", "difference", "interval", "p"),
            rows,
            lead=1,
        )
    ]


def class_table(found: DetectorEvaluation) -> Table:
    rows = []
    pairs = list(zip(found.five.classes, found.at_stated.classes, strict=True))
    for matched, scores in pairs:
        precision = matched.average_precision
        rows.append(
            text_cells(
                matched.name,
                f"{matched.objects}",
                percent(float(precision[HALF])),
                percent(float(precision.mean())),
                percent(scores.precision),
                percent(scores.recall),
                percent(scores.f1),
                f"{scores.hits}",
                f"{scores.false_alarms}",
            )
        )
    defects = found.coarse.classes[0]
    values = defects.average_precision
    rows.append(
        text_cells(
            "Road Defect (coarse)",
            f"{defects.objects}",
            percent(float(values[HALF])),
            percent(float(values.mean())),
            *("",) * 5,
        )
    )
    return Table(
        f"By class: number of objects, average precision, and at confidence {found.at_stated.confidence:g} precision, "
        "recall and F1, in per cent, with numbers of hits and false alarms.",
        ("class", "objects", "AP@0.5", "AP@0.5:0.95", "precision", "recall", "F1", "hits", "false alarms"),
        tuple(rows),
        lead=1,
    )


def _confusion(found: DetectorEvaluation) -> list[Block]:
    blocks: list[Block] = [figures.confusion_figure(found)]
    for words, scores in (
        ("matched predicted regions", found.subtypes_matched),
        ("true regions", found.subtypes_true),
    ):
        if scores is not None and scores.regions:
            blocks.append(_subtype_table(words, scores))
    return blocks


def _subtype_table(words: str, scores: SubtypeScores) -> Table:
    rows = tuple(
        text_cells(name, *(f"{count}" for count in counts.tolist()), percent(f1))
        for name, counts, f1 in zip(SUBTYPE_LABELS, scores.counts, scores.f1, strict=True)
    )
    return Table(
        f"Subtypes on {words}: {scores.regions} defects, macro F1 {percent(scores.macro_f1)}\u00a0%, "
        f"{percent(scores.accuracy)}\u00a0% right.",
        ("true", *SUBTYPE_LABELS, "F1 %"),
        rows,
        lead=1,
        span="reported",
    )


def _conditions(found: DetectorEvaluation) -> list[Block]:
    rows = tuple(
        text_cells(
            each.words,
            each.values,
            f"{each.images}",
            f"{each.objects}",
            percent(each.recall),
            percent(each.precision),
            percent(each.average_precision),
        )
        for each in found.breakdowns
    )
    drawn = figures.breakdown_figure(found)
    table = Table(
        f"Recall and precision of all classes together at confidence {found.at_stated.confidence:g}, and mAP@0.5, in "
        "per cent.",
        ("by", "range", "images", "objects", "recall", "precision", "mAP@0.5"),
        rows,
        notes=["A detection has no visible share and no contrast: by properties of objects there is recall alone."],
    )
    return [*([drawn] if drawn is not None else []), *([table] if rows else [])]


def _calibration_words(found: DetectorEvaluation) -> str:
    every, used = found.reliability, found.reliability_in_use
    return (
        f"The expected calibration error is {percent(every.error)} % over all {every.detections} detections, and "
        f"{percent(used.error)} % over the {used.detections} from confidence {used.least:g} on."
    )


def _sizes(found: DetectorEvaluation) -> list[Block]:
    if not found.sizes:
        return []
    words = {"area_m2": "area", "length_m": "length", "mean_width_mm": "mean width", "diameter_mm": "diameter"}
    rows = tuple(
        text_cells(
            words[each.size],
            each.name,
            f"{each.defects}",
            f"{each.mean_absolute_percentage:.1f}",
            f"{each.bias_percentage:+.1f}",
        )
        for each in found.sizes
    )
    return [
        Table(
            "Sizes of matched defects that are wholly in the image and wholly seen, against their true ones: mean "
            "absolute percentage error, and mean signed error.",
            ("size", "class", "defects", "error %", "bias %"),
            rows,
        )
    ]


def _severities(found: DetectorEvaluation) -> list[Block]:
    if not found.severities:
        return []
    rows = tuple(
        text_cells(
            each.name,
            *map(
                str,
                (each.defects, each.right, each.within, each.too_low, each.too_high, each.not_resolvable),
            ),
        )
        for each in found.severities
    )
    return [
        Table(
            "Severities (ASTM D6433) of the same defects: how many are right, how many leave two open of which one is "
            "right, how many are less or more severe than the true one, and how many the picture does not show.",
            ("class", "defects", "right", "one of two", "too low", "too high", "not resolvable"),
            rows,
            lead=1,
        )
    ]


def _errors(found: DetectorEvaluation) -> list[Block]:
    at = f"{found.at_stated.confidence:g}"
    return [
        each
        for each in (
            worst.sheet(
                found,
                worst.false_alarms(found),
                "False alarms",
                f"The most confident wrong detections, from confidence {at} on. Thin boxes are labels, "
                "thick corners detections, of what overlaps the error.",
            ),
            worst.sheet(
                found,
                worst.missed(found),
                "Missed",
                f"The largest objects of each class that no detection of it was matched to at confidence {at}.",
            ),
        )
        if each is not None
    ]


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
        f"{counted(found.total, 'detection')} in {images} of the split {found.split.name}, {empty} of them without any "
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

"""Tables of the model card, as Markdown: what detectors find, by class and ground resolution, and errors of sizes."""

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Final

from benchmarks.adaptation import cells_of
from pavetwin.perception.classes import SIZES
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.evaluate import DetectorEvaluation, compare_in_pairs, evaluate
from pavetwin.training.evaluation.labelled import LabelledSplit

METRICS: Final = {
    "map50": "mAP@0.5",
    "map50_95": "mAP@0.5:0.95",
    "f1": "macro F1",
    "coarse_map50": "coarse mAP@0.5",
    "ap50 Road Defect": "Road Defect AP@0.5",
}

Runs = Mapping[str, Sequence[Mapping[str, list[FoundBox]]]]
"""`TRAINING SIZE` → what each of its runs, one a seed, finds in each test split."""


def tables_of(runs: Runs, splits: Mapping[str, LabelledSplit], resamples: int) -> str:
    """Per cent. First all trainings with their differences to the first one, paired by image, whose intervals hold the
    spread between seeds; then, of the first seed of each, classes, ground resolutions and size errors."""
    parts = []
    for where, split in splits.items():
        found = {name: [each[where] for each in seeds] for name, seeds in runs.items()}
        parts.append(f"## {where}: {len(split.images)} test images")
        parts += compared(found, split, resamples)
        for name, seeds in found.items():
            first = evaluate(split, seeds[0], resamples=resamples)
            parts += [f"### {name} on {where}, seed 0", by_class(first), by_resolution(first), size_errors(first)]
    return "\n\n".join(filter(None, parts)) + "\n"


def compared(found: Mapping[str, Sequence[list[FoundBox]]], split: LabelledSplit, resamples: int) -> list[str]:
    """A table for each metric: mean of the runs, each run, difference to the first training."""
    base = next(iter(found))
    pairs = {name: compare_in_pairs(split, found[base], runs, resamples=resamples) for name, runs in found.items()}
    tables = []
    for key, words in METRICS.items():
        rows = [f"| training | {words} | of each run | less {base}, 95 % interval |", "|---" * 4 + "|"]
        rows += [f"| {name} | {cells_of(each, key, is_base=name == base)} |" for name, each in pairs.items()]
        tables.append("\n".join(rows))
    return tables


def by_class(found: DetectorEvaluation) -> str:
    """A row for each class that has objects: average precision with its interval, precision and recall."""
    heads = ("", "AP@0.5", "AP@0.5:0.95", "precision", "recall", "objects")
    rows = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for matched, scores in zip(found.five.classes, found.at_stated.classes, strict=True):
        if matched.objects:
            half = found.intervals[f"ap50 {matched.name}"]
            cells = (
                f"{_percent(half.value)} ({_percent(half.low)} to {_percent(half.high)})",
                _percent(float(matched.average_precision.mean())),
                *(_percent(each) for each in (scores.precision, scores.recall)),
            )
            rows.append(f"| {matched.name} | {' | '.join(cells)} | {matched.objects} |")
    whole = found.intervals["map50"]
    cells = (
        f"{_percent(whole.value)} ({_percent(whole.low)} to {_percent(whole.high)})",
        _percent(found.five.mean_precision()),
        *(_percent(each) for each in (found.at_stated.precision, found.at_stated.recall)),
    )
    objects = sum(each.objects for each in found.five.classes)
    rows.append(f"| mean of the classes with objects | {' | '.join(cells)} | {objects} |")
    return "\n".join(rows)


def by_resolution(found: DetectorEvaluation) -> str:
    """A column for each range of ground resolutions; empty where images do not tell theirs."""
    ranges = [each for each in found.breakdowns if each.name == "gsd_mm"]
    if not ranges:
        return ""
    rows = {
        "mAP@0.5": [_percent(each.average_precision) for each in ranges],
        "recall": [_percent(each.recall) for each in ranges],
        "images": [str(each.images) for each in ranges],
    }
    heads = [f"| ground resolution | {' | '.join(each.values for each in ranges)} |", "|---" * (1 + len(ranges)) + "|"]
    return "\n".join([*heads, *(f"| {name} | {' | '.join(cells)} |" for name, cells in rows.items())])


def size_errors(found: DetectorEvaluation) -> str:
    """Mean absolute percentage errors of defects that are whole and wholly seen; empty where none was measured."""
    if not found.sizes:
        return ""
    rows = [f"| size errors | {' | '.join(SIZES)} | defects |", "|---" * (2 + len(SIZES)) + "|"]
    for name in dict.fromkeys(each.name for each in found.sizes):
        mine = {each.size: each for each in found.sizes if each.name == name}
        cells = [f"{mine[size].mean_absolute_percentage:.1f}" if size in mine else "" for size in SIZES]
        rows.append(f"| {name} | {' | '.join(cells)} | {max(each.defects for each in mine.values())} |")
    return "\n".join(rows)


def _percent(value: float | None) -> str:
    return "–" if value is None or isnan(value) else f"{100 * value:.1f}"

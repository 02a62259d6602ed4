"""An evaluation as plain values: for a JSON file, and as rows of CSV files. What is undefined is null, or empty."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

from pavetwin.labels.class_names import CLASS_LABELS, SUBTYPE_LABELS
from pavetwin.training.evaluation.evaluate import DetectorEvaluation
from pavetwin.training.evaluation.matching import HALF, THRESHOLDS, Matched
from pavetwin.training.evaluation.resampling import Metrics, ResampledDifference, ResampledInterval
from pavetwin.training.evaluation.scores import Reliability, ScoresAt, SubtypeScores


def as_values(found: DetectorEvaluation) -> dict[str, Any]:
    """All results by name; shares are in 0 … 1."""
    split = found.split
    return {
        "split": split.name,
        "images": len(split.images),
        "empty_images": sum(not image.regions for image in split.images),
        "groups": len({image.group for image in split.images}),
        "detections": found.total,
        "detections_of_unlabelled_classes": found.unlabelled,
        "map50": defined(found.five.mean_precision(HALF)),
        "map50_95": defined(found.five.mean_precision()),
        "coarse_map50": defined(found.coarse.mean_precision(HALF)),
        "coarse_map50_95": defined(found.coarse.mean_precision()),
        "classes": _classes(found.five),
        "coarse_classes": _classes(found.coarse),
        "at_stated": _scores(found.at_stated),
        "at_best_of_validation": _scores(found.at_best) if found.at_best is not None else None,
        "subtypes_on_matched_regions": _subtypes(found.subtypes_matched),
        "subtypes_on_true_regions": _subtypes(found.subtypes_true) if found.subtypes_true is not None else None,
        "confusion": {"names": [*CLASS_LABELS, "background"], "counts": found.confusion.tolist()},
        "calibration": _calibration(found.reliability),
        "calibration_in_use": _calibration(found.reliability_in_use),
        "intervals": intervals_as_values(found.intervals),
        "breakdowns": breakdown_rows(found),
        "sizes": size_rows(found),
        "severities": severity_rows(found),
    }


def intervals_as_values(
    found: Mapping[str, ResampledInterval] | Mapping[str, ResampledDifference],
) -> dict[str, dict[str, float | None]]:
    """Each metric's value, low and high, and p of a difference."""
    names = ("value", "low", "high", "p")
    return {
        metric: {name: defined(getattr(each, name)) for name in names if hasattr(each, name)}
        for metric, each in found.items()
    }


def runs_as_values(runs: Iterable[Metrics]) -> list[dict[str, float | None]]:
    """The metrics of each run."""
    return [{name: defined(value) for name, value in run.items()} for run in runs]


def defined(value: float) -> float | None:
    """None for what has no value."""
    return float(value) if isfinite(value) else None


def _classes(matched: Matched) -> dict[str, dict[str, Any]]:
    return {
        each.name: {
            "objects": each.objects,
            "ap50": defined(float(each.average_precision[HALF])),
            "ap50_95": defined(float(each.average_precision.mean())),
            "ap": {
                f"{at:.2f}": defined(float(value)) for at, value in zip(THRESHOLDS, each.average_precision, strict=True)
            },
        }
        for each in matched.classes
    }


def _scores(at: ScoresAt) -> dict[str, Any]:
    return {
        "confidence": at.confidence,
        "macro_precision": at.precision,
        "macro_recall": at.recall,
        "macro_f1": at.f1,
        "classes": {
            each.name: {
                key: getattr(each, key) for key in ("objects", "hits", "false_alarms", "precision", "recall", "f1")
            }
            for each in at.classes
        },
    }


def _subtypes(scores: SubtypeScores) -> dict[str, Any]:
    return {
        "regions": scores.regions,
        "macro_f1": scores.macro_f1,
        "accuracy": scores.accuracy,
        "f1": dict(zip(SUBTYPE_LABELS, scores.f1, strict=True)),
        "counts": scores.counts.tolist(),
    }


def _calibration(of: Reliability) -> dict[str, Any]:
    return {
        "from_confidence": of.least,
        "detections": of.detections,
        "expected_calibration_error": of.error,
        "bins": [
            {
                "low": each.low,
                "high": each.high,
                "detections": each.detections,
                "mean_confidence": each.confidence,
                "precision": each.precision,
            }
            for each in of.bins
        ],
    }


def breakdown_rows(found: DetectorEvaluation) -> list[dict[str, Any]]:
    return [
        {
            "property": each.name,
            "low": defined(each.low),
            "high": defined(each.high),
            "images": each.images,
            "objects": each.objects,
            "hits": each.hits,
            "recall": each.recall,
            "precision": each.precision,
            "map50": each.average_precision,
        }
        for each in found.breakdowns
    ]


def size_rows(found: DetectorEvaluation) -> list[dict[str, Any]]:
    return [
        {
            "size": each.size,
            "class": each.name,
            "defects": each.defects,
            "mean_absolute_percentage_error": each.mean_absolute_percentage,
            "bias_percentage": each.bias_percentage,
        }
        for each in found.sizes
    ]


def severity_rows(found: DetectorEvaluation) -> list[dict[str, Any]]:
    return [
        {"class" if name == "name" else name: value for name, value in asdict(each).items()}
        for each in found.severities
    ]


def csv_files(found: DetectorEvaluation) -> dict[str, str]:
    """Name of the file → its content."""
    values = as_values(found)
    classes = [
        {
            "class": name,
            **{key: row[key] for key in ("objects", "ap50", "ap50_95")},
            **values["at_stated"]["classes"][name],
        }
        for name, row in values["classes"].items()
    ]
    names = values["confusion"]["names"]
    confusion = [
        {"true": name, **dict(zip(names, row, strict=True))}
        for name, row in zip(names, values["confusion"]["counts"], strict=True)
    ]
    tables: dict[str, Sequence[Mapping[str, Any]]] = {
        "classes.csv": classes,
        "confusion.csv": confusion,
        "breakdowns.csv": values["breakdowns"],
        "calibration.csv": values["calibration"]["bins"],
        "intervals.csv": [{"metric": name, **row} for name, row in values["intervals"].items()],
        "sizes.csv": values["sizes"],
        "severities.csv": values["severities"],
    }
    return {name: _csv(rows) for name, rows in tables.items() if rows}


def _csv(rows: Iterable[Mapping[str, Any]]) -> str:
    held = list(rows)
    text = io.StringIO()
    writer = csv.DictWriter(text, held[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(held)
    return text.getvalue()

"""`pavetwin evaluate`: quality of detections against a dataset's labels."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli.console import out, progress, table
from pavetwin.errors import PaveTwinError, about, no_such
from pavetwin.files import check_folder
from pavetwin.reports.words import counted

if TYPE_CHECKING:
    from collections.abc import Callable

    from pavetwin.training.evaluation.detections import FoundBox
    from pavetwin.training.evaluation.evaluate import DetectorEvaluation, PairedComparison
    from pavetwin.training.evaluation.labelled import LabelledSplit
    from pavetwin.training.trainer.weights_detector import WeightsDetector

WEIGHTS = ".pt"
"""Suffix of a file of weights, which PyTorch runs."""

VALIDATION = "val"
"""The split on which the best confidence is chosen."""


def evaluate(
    detections: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL",
            help="model.onnx, a shipped detector by name, weights such as best.pt, or detections (COCO).",
        ),
    ],
    dataset: Annotated[Path, typer.Argument(help="Folder with annotations/instances_SPLIT.json and images/SPLIT/.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the report.")],
    split: Annotated[str, typer.Option(help="Split of the dataset: test, val or train.")] = "test",
    confidence: Annotated[float, typer.Option(help="Confidence at which precision, recall and F1 are stated.")] = 0.25,
    against: Annotated[
        list[Path] | None,
        typer.Option(help="Another model or its detections, to state the differences; repeat it for several runs."),
    ] = None,
    runs: Annotated[
        list[Path] | None,
        typer.Option(
            "--run", metavar="MODEL", help="The same training with another seed, for --against; may be repeated."
        ),
    ] = None,
    overview: Annotated[
        bool,
        typer.Option(
            "--overview",
            help="Search in tiles and in the whole image, as `detect --overview`; for MODEL and --run only.",
        ),
    ] = False,
    regions: Annotated[
        Path | None, typer.Option(help="File with subtypes of true regions; see the how-to page on evaluation.")
    ] = None,
    true_regions: Annotated[
        bool,
        typer.Option("--true-regions", help="Also classify true regions with a model; needs PyTorch and onnx."),
    ] = False,
    resamples: Annotated[int, typer.Option(help="Resamples of the bootstrap over images; 0 for no intervals.")] = 1000,
    seed: Annotated[int, typer.Option(help="Random seed of the bootstrap.")] = 0,
) -> None:
    """Evaluate a model or detections against a dataset's labels: average precision, errors, and what they depend on.

    \b
    pavetwin evaluate model.onnx datasets/streets -o evaluation
    pavetwin evaluate detections.json datasets/streets -o evaluation
    pavetwin evaluate mine.onnx datasets/mine -o evaluation --against rendered
    pavetwin evaluate rendered datasets/streets -o evaluation --overview --against rendered
    pavetwin evaluate mixed.json datasets/china-coco -o evaluation --against real-only.json
    pavetwin evaluate m0.onnx china-coco -o report --run m1.onnx --run m2.onnx --against r0.onnx --against r1.onnx

    The dataset is a capture, or a result of `pavetwin data export --formats coco`. A file may hold detections of the
    split val too, on which the confidence with the best F1 is chosen.

    Needs pycocotools (`pip install 'pavetwin\\[evaluate]'`), for a model onnxruntime too, and for weights and
    --true-regions PyTorch. Evaluating weights always classifies true regions.
    """
    from pavetwin.labels import SPLITS
    from pavetwin.perception.model_file import model_path
    from pavetwin.training.evaluation.detections import read_subtypes
    from pavetwin.training.evaluation.evaluate import check_evaluation, compare_in_pairs
    from pavetwin.training.evaluation.evaluate import evaluate as evaluated
    from pavetwin.training.evaluation.labelled import read_split
    from pavetwin.training.report.page import write_detector_report

    if split not in SPLITS:
        raise PaveTwinError(no_such("split", split, SPLITS, key="`split`"))
    with about("output"):
        check_folder(output)
    check_evaluation(confidence, resamples, seed)
    if true_regions and regions is not None:
        raise PaveTwinError("`regions` and `true_regions` exclude each other; give one of them.")
    if true_regions and detections.suffix.lower() == ".json":
        raise PaveTwinError("`true_regions`: a file of detections has no subtype head; give `regions` instead.")
    if true_regions:
        from pavetwin.cli.train import check_torch

        check_torch("Classifying true regions")  # before the detector runs
    if runs and not against:
        raise PaveTwinError("`run`: further runs are for differences only; name the other detections with `against`.")
    with progress("Evaluating") as report:
        chosen = read_split(dataset, split)
        splits = (chosen, *_others(dataset, chosen))
        found = _found(detections, splits, report, overview=overview)
        subtypes = differences = None
        with about("against"):
            others = [_found(each, splits, report, models_in=1) for each in against or ()]
        with about("run"):
            same = [found, *(_found(each, splits, report, models_in=1, overview=overview) for each in runs or ())]
        if regions is not None:
            with about("regions"):
                subtypes = read_subtypes(regions, chosen)
        elif true_regions or detections.suffix.lower() == WEIGHTS:
            from pavetwin.training.evaluation.detections import subtypes_by

            weights = detections if detections.suffix.lower() == WEIGHTS else model_path(detections)
            subtypes = subtypes_by(_of_weights(weights), chosen)
        validation = next((each for each in splits[1:] if each.name == VALIDATION), None)
        how: dict[str, Any] = {"confidence": confidence, "resamples": resamples, "seed": seed}
        result = evaluated(chosen, found, validation=validation, subtypes=subtypes, **how)
        report(0.5)
        if others:
            differences = compare_in_pairs(chosen, others, same, **how)
        report(0.7)
        title = f"{detections.stem}, in tiles and as a whole" if overview else detections.stem
        files = write_detector_report(result, output, title=title, differences=differences)
    _print_result(result)
    if differences is not None:
        _print_differences(differences)
    out.line(f"Report: {files[0]}")


def _found(
    path: Path,
    splits: "tuple[LabelledSplit, ...]",
    report: "Callable[[float], None]",
    models_in: int | None = None,
    *,
    overview: bool = False,
) -> "tuple[FoundBox, ...]":
    """Detections of a model in the splits, or those of a file.

    Args:
        models_in: number of the first splits in which a model detects; None for those needed by its evaluation.
        overview: whether a model detects in tiles and in the whole image.
    """
    from pavetwin.perception.model_file import model_path
    from pavetwin.training.evaluation.detections import read_detections

    if not path.exists() and path.suffix.lower() not in (".json", WEIGHTS):
        path = model_path(path)
    kind = path.suffix.lower()
    if kind not in (".onnx", WEIGHTS):
        if overview:
            raise PaveTwinError(f"`overview`: '{path}' is a file of detections, which has no detector to run.")
        return read_detections(path, tuple(each for each in splits if not each.is_renumbered))
    from pavetwin.perception.detector import Detector
    from pavetwin.training.evaluation.detections import LEAST_CONFIDENCE, found_by

    looked_at = [splits[0], *(each for each in splits[1:models_in] if each.name == VALIDATION)]
    if kind == WEIGHTS:
        return found_by(_of_weights(path, overview=overview), looked_at, report)
    return found_by(Detector(path, confidence=LEAST_CONFIDENCE, overview=overview), looked_at, report)


def _of_weights(path: Path, *, overview: bool = False) -> "WeightsDetector":
    from pavetwin.cli.train import check_torch
    from pavetwin.training.evaluation.detections import LEAST_CONFIDENCE

    check_torch("Evaluating weights")
    from pavetwin.training.trainer.weights_detector import WeightsDetector

    return WeightsDetector(path, confidence=LEAST_CONFIDENCE, overview=overview)


def _others(dataset: Path, chosen: "LabelledSplit") -> "list[LabelledSplit]":
    """Other splits of the dataset that a file of detections may cover, with distinct image numbers."""
    from pavetwin.training.evaluation.labelled import numbered_after, read_split

    names = [name for name in (VALIDATION, "test") if name != chosen.name]
    there = [name for name in names if (dataset / "annotations" / f"instances_{name}.json").is_file()]
    return [numbered_after(read_split(dataset, name), chosen) for name in there]


def _percent(value: float | None) -> str:
    return "–" if value is None or isnan(value) else f"{100 * value:.1f}"


def _interval(low: float, high: float) -> str:
    return "" if isnan(low) else f"{100 * low:.1f} – {100 * high:.1f}"


def _print_result(result: "DetectorEvaluation") -> None:
    """Print a row for each class, and the metrics of all with their intervals."""
    from pavetwin.training.evaluation.matching import HALF
    from pavetwin.training.report.page import METRICS

    shown = table("per cent", "objects", "AP@0.5", "AP@0.5:0.95", "precision", "recall", "F1")
    for matched, scores in zip(result.five.classes, result.at_stated.classes, strict=True):
        precision = matched.average_precision
        values = (float(precision[HALF]), float(precision.mean()), scores.precision, scores.recall, scores.f1)
        shown.add_row(matched.name, str(matched.objects), *map(_percent, values))
    out.print(shown)
    out.line("")
    shown = table("all classes, per cent", "value", "95 % interval")
    for name, words in METRICS.items():
        each = result.intervals[name]
        shown.add_row(words, _percent(each.value), _interval(each.low, each.high))
    shown.add_row("subtype macro F1 on matched regions", _percent(result.subtypes_matched.macro_f1), "")
    if result.subtypes_true is not None:
        shown.add_row("subtype macro F1 on true regions", _percent(result.subtypes_true.macro_f1), "")
    if result.at_best is not None:
        words = f"macro F1 at {result.at_best.confidence:.3f}, best of the split {VALIDATION}"
        shown.add_row(words, _percent(result.at_best.f1), "")
    shown.add_row("expected calibration error", _percent(result.reliability_in_use.error), "")
    out.print(shown)
    images = counted(len(result.split.images), "image")
    empty = sum(not image.regions for image in result.split.images)
    out.line(
        f"\n{images}, {empty} of them empty. Precision, recall, F1 and calibration: confidence from "
        f"{result.at_stated.confidence:g}, IoU 0.5."
    )
    if result.unlabelled:
        left = counted(result.unlabelled, "detection")
        out.line(f"Left out: {left} of classes that an image's source does not label.")


def _print_differences(found: "PairedComparison") -> None:
    from pavetwin.training.report.page import METRICS

    shown = table("minus the others, points", "these", "others", "difference", "95 % interval", "p")
    for name, words in METRICS.items():
        each = found.differences[name]
        p = "" if isnan(each.p) else f"{each.p:.3f}"
        means = (_percent(sum(run[name] for run in of) / len(of)) for of in (found.second, found.first))
        shown.add_row(words, *means, f"{100 * each.value:+.1f}", _interval(each.low, each.high), p)
    out.line("")
    out.print(shown)
    these, others = len(found.second), len(found.first)
    if these + others > 2:
        out.line(f"\nMeans of {these} and {others} runs; the intervals include the spread between runs.")

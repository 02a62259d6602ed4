"""Figures of an evaluation."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from pavetwin.draw import style
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.labels.classes import colours
from pavetwin.reports import canvas
from pavetwin.reports.blocks import ReportFigure
from pavetwin.training.evaluation.breakdowns import Breakdown
from pavetwin.training.evaluation.evaluate import DetectorEvaluation
from pavetwin.training.evaluation.matching import HALF, MatchedClass

_PERCENT: Final = PercentFormatter(1.0, decimals=0, symbol=" %")
_DASHES: Final = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1)))
"""Line styles of the five classes, for grey print."""


def precision_figure(found: DetectorEvaluation) -> ReportFigure:
    """Precision over recall of each class, with the stated confidence marked."""
    colour = colours(CLASS_LABELS)
    with style.styled():
        figure = style.new_figure(0.9 * canvas.WIDTH_IN, 3.2)
        figure.set_layout_engine("constrained")
        axes = figure.subplots()
        for each, dash in zip(found.five.classes, _DASHES, strict=True):
            if not each.objects:
                continue
            recall, precision = _curve(each)
            label = f"{each.name} (AP {100 * each.average_precision[HALF]:.1f} %, {each.objects})"
            axes.plot(recall, precision, color=colour[each.name], linestyle=dash, label=label)
            scores = next(row for row in found.at_stated.classes if row.name == each.name)
            if scores.precision is not None and scores.recall is not None:
                axes.plot(
                    scores.recall,
                    scores.precision,
                    "o",
                    color=colour[each.name],
                    markersize=5,
                    markeredgecolor=style.INK,
                )
        axes.set(xlim=(0, 1.01), ylim=(0, 1.02), xlabel="recall", ylabel="precision")
        axes.xaxis.set_major_formatter(_PERCENT)
        axes.yaxis.set_major_formatter(_PERCENT)
        figure.legend(loc="outside right upper", borderaxespad=0.2)
    at = f"{found.at_stated.confidence:g}"
    return canvas.vector(
        figure,
        f"Precision over recall at IoU 0.5, by class; in brackets the average precision and the number of objects. "
        f"Dots are at confidence {at}.",
        "Curves of precision over recall, one for each class",
    )


def _curve(each: MatchedClass) -> tuple[list[float], list[float]]:
    kept = ~each.left_out[HALF]
    hits = np.cumsum(each.hit[HALF][kept])
    precision = hits / np.arange(1, len(hits) + 1)
    return [0.0, *(hits / each.objects).tolist()], [float(precision[0]) if len(hits) else 0.0, *precision.tolist()]


def confusion_figure(found: DetectorEvaluation) -> ReportFigure:
    """Shares of the true objects of a class, with counts."""
    names = [*CLASS_LABELS, "background"]
    counts = found.confusion
    total = counts.sum(axis=1, keepdims=True)
    share = np.divide(counts, total, out=np.zeros(counts.shape), where=total > 0)
    share[-1] = 0.0
    with style.styled():
        figure = style.new_figure(0.74 * canvas.WIDTH_IN, 3.9)
        figure.set_layout_engine("constrained")
        axes = figure.subplots()
        axes.imshow(share, cmap="Blues", vmin=0, vmax=1.25)
        for row in range(len(names)):
            for column in range(len(names)):
                if row == column == len(names) - 1:
                    continue
                ink = style.PAPER if share[row, column] > 0.6 else style.INK
                percent = f"\n{100 * share[row, column]:.0f} %" if total[row, 0] and row < len(names) - 1 else ""
                if counts[row, column]:
                    text = f"{counts[row, column]}{percent}"
                    axes.text(column, row, text, ha="center", va="center", color=ink, fontsize=7)
        labels = [name.replace(" ", "\n") for name in names]
        axes.set_xticks(range(len(names)), [*labels[:-1], "missed"])
        axes.set_yticks(range(len(names)), [*labels[:-1], "back-\nground"])
        axes.set(xlabel="reported", ylabel="true")
        axes.grid(False)
        axes.tick_params(length=0)
    return canvas.vector(
        figure,
        f"What is taken for what, at confidence {found.at_stated.confidence:g} and IoU 0.5: numbers of objects, and "
        "shares of the true ones. The last row are false alarms, the last column missed objects.",
        "Confusion matrix of the five classes and background",
    )


def calibration_figure(found: DetectorEvaluation) -> ReportFigure:
    """Precision over confidence, with the number of detections."""
    bins = [each for each in found.reliability.bins if each.detections]
    with style.styled():
        figure = style.new_figure(0.6 * canvas.WIDTH_IN, 3.4)
        figure.set_layout_engine("constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        upper.plot([0, 1], [0, 1], color=style.INK_FAINT, linewidth=0.9, linestyle=(0, (4, 2)))
        upper.plot(
            [each.confidence for each in bins], [each.precision for each in bins], "o-", color=style.BASE, markersize=4
        )
        upper.set(xlim=(0, 1), ylim=(0, 1.02), ylabel="share that is right")
        upper.yaxis.set_major_formatter(_PERCENT)
        lower.bar([each.low + 0.05 for each in bins], [each.detections for each in bins], 0.09, color=style.INK_FAINT)
        lower.set(ylabel="detections", xlabel="confidence")
        canvas.logarithmic(lower.yaxis)
    return canvas.vector(
        figure,
        "How often detections of a confidence are right, at IoU 0.5. Above the dashed line the detector is more often "
        "right than its confidence. Below: the number of detections.",
        "Reliability of confidences",
    )


def breakdown_figure(found: DetectorEvaluation) -> ReportFigure | None:
    """Recall by each property, with the number of objects; None where nothing is known."""
    groups: dict[str, list[Breakdown]] = {}
    for row in found.breakdowns:
        if row.objects:
            groups.setdefault(row.words, []).append(row)
    groups = {words: rows for words, rows in groups.items() if len(rows) > 1}
    if not groups:
        return None
    columns = 2
    lines = -(-len(groups) // columns)
    tallest = max(map(len, groups.values()))
    with style.styled():
        figure = style.new_figure(canvas.WIDTH_IN, lines * (0.55 + 0.19 * tallest) + 0.15)
        figure.set_layout_engine("constrained", h_pad=0.06, w_pad=0.05)
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for axes, (words, rows) in zip(panels, groups.items(), strict=False):
            _bars(axes, words, rows)
        for axes in panels[len(groups) :]:
            axes.set_axis_off()
    return canvas.vector(
        figure,
        f"Recall of all classes together at confidence {found.at_stated.confidence:g} and IoU 0.5, by what is known of "
        "images and objects, with the number of objects next to each bar.",
        "Recall by altitude, ground resolution, light, size, visible share and contrast",
    )


def _bars(axes: Axes, words: str, rows: list[Breakdown]) -> None:
    recall = [row.recall or 0.0 for row in rows]
    places = list(range(len(rows)))
    axes.barh(places, recall, 0.72, color=style.BASE)
    for place, value, row in zip(places, recall, rows, strict=True):
        axes.text(value + 0.012, place, f"{row.objects}", va="center", fontsize=6, color=style.INK_SOFT)
    axes.set_yticks(places, [row.values for row in rows])
    axes.set(xlim=(0, 1.12), ylim=(len(rows) - 0.5, -0.5), xticks=[0, 0.25, 0.5, 0.75, 1])
    axes.xaxis.set_major_formatter(_PERCENT)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    canvas.panel_title(axes, words)

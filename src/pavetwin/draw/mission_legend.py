"""The legend of a mission's map: main numbers, meaning of the marks, colours of visibility."""

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pavetwin.draw import style
from pavetwin.draw.marks import DefectOutcome, outcomes
from pavetwin.draw.mission_layers import AVOID, BATTERY, CAPTURED, GAP, REVISIT, STEP, WAIT
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.track import avoiding, displacements, revisits, waits

Handle = Artist | tuple[Artist, ...]


def main_numbers(result: MissionResult) -> list[tuple[str, str]]:
    """The mission's results, as names and readable values."""
    rows = result.rows
    defects, confirmed = sum(row.defects for row in rows), sum(row.confirmed for row in rows)
    area = sum(row.area_m2 for row in rows)
    minutes, seconds = divmod(round(result.duration_s), 60)
    numbers = [("Segments inspected", f"{sum(row.inspected for row in rows)} of {len(rows)}")]
    if defects:
        numbers.append(("Coverage", f"{confirmed} of {defects} ({100 * confirmed / defects:.0f} %)"))
    recovered = sum(row.recovered for row in rows)
    if recovered:
        numbers.append(("Recovered on revisits", f"{recovered}"))
    if area:
        covered = sum(row.surface_coverage * row.area_m2 for row in rows) / area
        numbers.append(("Surface coverage", f"{100 * covered:.1f} %"))
    numbers += [
        ("Time", f"{minutes}:{seconds:02d} min"),
        ("Waiting", f"{sum(row.wait_s for row in rows):.0f} s"),
        ("Occlusions", f"{sum(row.occlusions for row in rows)}"),
        ("Distance", f"{result.distance_m / 1000:.2f} km"),
        ("Energy", f"{100 * result.energy:.0f} % of a battery"),
    ]
    if result.swaps:
        numbers.append(("Battery swaps", f"{result.swaps}"))
    return numbers


def legend_of(results: Sequence[MissionResult], *, town: bool) -> tuple[list[Handle], list[str]]:
    """Only what is on the map."""
    handles: list[Handle] = []
    labels: list[str] = []

    def add(handle: Handle, label: str) -> None:
        handles.append(handle)
        labels.append(label)

    add(Line2D([], [], color=style.INK, linewidth=0.8), "Transit")
    ramp = tuple(Line2D([], [], color=style.VISIBILITY(o), linewidth=2.6) for o in (0.3, 0.7, 1.0))
    add(ramp, "Inspection, by visibility o")
    add(Patch(facecolor=CAPTURED), "In a captured window")
    add(Patch(facecolor=GAP), "In no captured window")
    found = {outcome for result in results for outcome in outcomes(result).values()}
    for outcome in DefectOutcome:
        if outcome in found:
            marker, colour = style.OUTCOME_MARKERS[outcome], style.OUTCOME_COLOURS[outcome]
            mark = Line2D([], [], marker=marker, color=colour, linestyle="", markersize=5, mec=style.PAPER, mew=0.4)
            add(mark, {DefectOutcome.RECOVERED: "Defect recovered on a revisit"}.get(outcome, f"Defect {outcome}"))
    if any(waits(result.track) for result in results):
        disc = Line2D([], [], marker="o", color=WAIT, linestyle="", mfc=WAIT + "38", markersize=8, mew=0.9)
        add(disc, "Waiting; area by seconds")
    if any(displacements(result.track) for result in results):
        add(Line2D([], [], marker="^" if town else ">", color=STEP, linestyle="", markersize=5), "Displacement")
    if any(revisits(result.track) for result in results):
        square = Line2D([], [], marker="s", color=REVISIT, linestyle="", mfc="none", markersize=6, mew=0.9)
        add(square, "Place revisited")
    if any(avoiding(result.track).any() for result in results):
        add(Line2D([], [], color=AVOID, linewidth=5, alpha=0.4), "Giving way to aircraft")
    if town:
        if results[0].swaps:
            add(Line2D([], [], marker="P", color=BATTERY, linestyle="", markersize=6), "Battery low")
        add(Line2D([], [], marker="o", color=style.BASE, linestyle="", markersize=7), "Base")
    return handles, labels


def visibility_ramp(axes: Axes, box: tuple[float, float, float, float], threshold: float) -> None:
    """The colours of visibility with τ_o marked; `box` in shares of the axes."""
    bar = axes.inset_axes(box)
    bar.imshow(np.linspace(0, 1, 256)[None], cmap=style.VISIBILITY, aspect="auto", extent=(0, 1, 0, 1))
    bar.set(yticks=[], xticks=[0, 0.5, threshold, 1], xticklabels=["0", "0.5", f"τ = {threshold:g}", "1"])
    bar.axvline(threshold, color=style.INK, linewidth=1.0)
    bar.tick_params(labelsize=7, length=2, pad=1.5)
    bar.set_title("Visibility o", fontsize=7.5, fontweight="normal", color=style.INK_SOFT, pad=3)
    bar.grid(False)
    for spine in bar.spines.values():
        spine.set_visible(False)

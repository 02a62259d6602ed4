"""The legend of a mission's map: main numbers, meaning of the marks, colours of visibility."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pavetwin.draw import style
from pavetwin.draw.marks import DefectOutcome, outcomes
from pavetwin.draw.mission_layers import AVOID, BATTERY, CAPTURED, GAP, PARKED, PARKED_EDGE, REVISIT, STEP, WAIT
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import avoiding, displacements, revisits, waits

Handle = Artist | tuple[Artist, ...]


def main_numbers(result: MissionResult) -> list[tuple[str, str]]:
    """The mission's results, as names and readable values."""
    rows = result.rows
    defects, confirmed = sum(row.defects for row in rows), sum(row.confirmed for row in rows)
    area = sum(row.area_m2 for row in rows)
    minutes, seconds = divmod(round(result.duration_s), 60)
    recovered, seen = sum(row.recovered for row in rows), 100 * result.settings.visibility.inspected_share
    covered = sum(row.surface_coverage * row.area_m2 for row in rows)
    hidden = sum(row.permanently_hidden * row.area_m2 for row in rows)
    numbers = (
        (
            True,
            "Segments inspected" if hidden else f"Segments at least {seen:g} % seen",
            f"{sum(row.inspected for row in rows)} of {len(rows)}",
        ),
        (defects, "Defects found", f"{confirmed} of {defects} ({100 * confirmed / max(1, defects):.0f} %)"),
        (recovered, "Found on return", f"{recovered}"),
        (area, "Surface seen", f"{100 * (covered / (area or 1)):.1f} %"),
        (hidden, "Surface that can be seen", f"{100 * (1 - hidden / (area or 1)):.1f} %"),
        (True, "Time", f"{minutes}:{seconds:02d} min"),
        (True, "Waiting", f"{sum(row.wait_s for row in rows):.0f} s"),
        (True, "Occlusions", f"{sum(row.occlusions for row in rows)}"),
        (True, "Distance", f"{result.distance_m / 1000:.2f} km"),
        (True, "Energy", f"{100 * result.energy:.0f} % of a battery"),
        (result.swaps, "Batteries to bring", f"{result.swaps + 1}"),
    )
    return [(name, value) for applies, name, value in numbers if applies]


def legend_of(results: Sequence[MissionResult], *, town: bool) -> tuple[list[Handle], list[str]]:
    """Only what is on the map."""
    ramp = tuple(Line2D([], [], color=style.VISIBILITY(o), linewidth=2.6) for o in (0.3, 0.7, 1.0))
    parked = Patch(facecolor=PARKED, edgecolor=PARKED_EDGE, linewidth=0.5)
    entries: list[tuple[object, Handle, str]] = [
        (True, Line2D([], [], color=style.INK, linewidth=0.8), "Transit"),
        (True, ramp, "Inspection, by visibility o"),
        (True, Patch(facecolor=CAPTURED), "In a captured window"),
        (True, Patch(facecolor=GAP), "In no captured window"),
        (any(len(result.environment.parked) for result in results), parked, "Parked vehicle"),
    ]
    found = {outcome for result in results for outcome in outcomes(result).values()}
    for outcome in DefectOutcome:
        mark = _mark(style.OUTCOME_MARKERS[outcome], style.OUTCOME_COLOURS[outcome], 5, mec=style.PAPER, mew=0.4)
        entries.append((outcome in found, mark, f"Defect {outcome}"))
    tracks = [result.track for result in results]
    gave_way = any(avoiding(track).any() for track in tracks)
    entries += [
        (any(map(waits, tracks)), _mark("o", WAIT, 8, mfc=WAIT + "38", mew=0.9), "Waiting; area by seconds"),
        (any(map(displacements, tracks)), _mark("^" if town else ">", STEP, 5), "Displacement"),
        (any(map(revisits, tracks)), _mark("s", REVISIT, 6, mfc="none", mew=0.9), "Place revisited"),
        (gave_way, Line2D([], [], color=AVOID, linewidth=5, alpha=0.4), "Giving way to aircraft"),
        (town and results[0].swaps, _mark("P", BATTERY, 6), "Battery low"),
        (town, _mark("o", style.BASE, 7), "Base"),
    ]
    shown = [(handle, label) for is_shown, handle, label in entries if is_shown]
    return [handle for handle, _ in shown], [label for _, label in shown]


def _mark(marker: str, colour: str, size_pt: float, **look: Any) -> Line2D:
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=size_pt, **look)


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

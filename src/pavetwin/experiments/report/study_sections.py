"""Sections about the whole study: factors, streets, recorded traffic and failures."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import shapely
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize

from pavetwin.draw import shapes, style
from pavetwin.draw.extent import credit, world_bounds
from pavetwin.draw.lettering import OccupiedSpace
from pavetwin.draw.world_map import ABOVE_WORLD, EVERYTHING, MapLayer, draw_world
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.metrics import COMPARED, FAILED, FLOWN, REASON, STATUS, metric_named
from pavetwin.experiments.planning import area_if_known, replaced_sentence
from pavetwin.experiments.report import figures
from pavetwin.experiments.report.study import AXES, METRIC, Group, Study
from pavetwin.experiments.statistics.effects import EFFECT_ALPHA, significant_terms
from pavetwin.experiments.words import factor_text, heading, level_text, shown, term_text
from pavetwin.reports.blocks import Block, ReportFigure, Section, Table, TableCell, text_cells
from pavetwin.reports.canvas import raster, vector
from pavetwin.reports.words import MISSING, counted, listed, number
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import level_of
from pavetwin.traffic.flow import MOST_REMOVALS_PER_HOUR, Flow, flow_of
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import load_recording
from pavetwin.traffic.tracks import STANDING_MPS
from pavetwin.world.model import Segment, World

_MOST_RESTS: Final = 3  # Combinations of the rest that one factor is drawn for
_MOST_MAPS: Final = 4
_WORST: Final = 10  # Segments in the table of the least covered
_FEW: Final = 10  # Fewer defects leave the coverage of a segment open: 3 of 6 found may be 12 to 88 %
_MOST_REASONS: Final = 20
_MOST_PLACES: Final = 4


def across_section(study: Study) -> Section:
    """Every factor that stands apart from left to right: the first levels of the rest, and as many more as there is
    room for."""
    blocks = [block for factor in study.apart for block in _across(study, factor)]
    return Section("across", f"Across {listed([factor_text(name).lower() for name in study.apart])}", blocks)


def _across(study: Study, factor: str) -> Iterator[Block]:
    names = [name for name in study.apart if name != factor]
    for rest in study.combinations(names)[:_MOST_RESTS]:
        group = Group(study, {**rest, **study.usual})
        words = ", ".join(f"{factor_text(n).lower()} {level_text(n, v)}" for n, v in group.key.items())
        for metric in (metric_named(name) for name in COMPARED):
            if metric not in study.metrics:
                continue
            yield vector(
                figures.across(group, factor, metric, group.traffics),
                f"{metric.label} over {factor_text(factor).lower()}{f' ({words})' if words else ''}: means with 95 % "
                "bootstrap intervals, a row for each altitude and a column for each traffic density.",
                f"Interval plots of {metric.label.lower()} over {factor_text(factor).lower()}, by altitude.",
            )


def effects_section(study: Study) -> Section:
    known = set(study.effects[METRIC].to_list()) if study.effects.height else set()
    metrics = [metric for metric in study.metrics if metric.name in known and metric.name in (*COMPARED, "recovery")]
    blocks: list[Block] = []
    if metrics:
        words = listed([metric.label.lower() for metric in metrics])
        blocks = [
            (
                "Replicates differ in street, traffic and defects; their share is what no altitude and no policy "
                "changes. An interaction (×) means that the effect of a factor depends on the level of the other; "
                "those of three and more factors are in the residual. p is not corrected here. "
                f"{_significant(study.effects)}"
            ),
            vector(
                figures.effect_bars(study.effects, metrics),
                f"Share of the variation of {words} that each term explains (analysis of variance with replicates as "
                f"blocks{_used(study.effects)}): η² of the whole as bars and numbers, "
                "partial ω² as diamonds and in brackets.",
                f"Bar charts of η² and ω² by term for {words}.",
            ),
        ]
    return Section("effects", "Which factor explains how much", blocks)


def _significant(effects: pl.DataFrame) -> str:
    """The terms that hold for coverage after correction."""
    main = COMPARED[0]
    terms = [term_text(term) for term in significant_terms(effects, main)]
    named = listed(terms) or "none"
    metric = metric_named(main).label.lower()
    return f"After Holm's correction for all terms of {metric}, significant at {100 * EFFECT_ALPHA:g} %: {named}."


def _used(effects: pl.DataFrame) -> str:
    """Number of replicates of the analysis, if the frame states it."""
    if "replicates" not in effects.columns:
        return ""
    least, most = (int(value) for value in effects.select(low=pl.min("replicates"), high=pl.max("replicates")).row(0))
    return f"; {least if least == most else f'{least} to {most}'} replicates have a value in every cell"


def streets_section(study: Study) -> Section:
    """A map of each world, and its least covered segments."""
    blocks: list[Block] = []
    for name in list(study.worlds)[:_MOST_MAPS]:
        means = street_means(study.by_segment, name)
        picture = street_map(study.worlds[name], means) if means.height else None
        if picture is not None:
            blocks += [picture, _worst(name, means), *_without_defects(study.by_segment, name)]
    return Section("streets", "Street by street", blocks)


def _without_defects(table: pl.DataFrame, world: str) -> list[str]:
    """Number of flown segments without coverage, if any."""
    flown = table.filter(pl.col("world") == world, pl.col(STATUS) == FLOWN)
    empty = flown.group_by("segment").agg(pl.col("coverage").count()).filter(pl.col("coverage") == 0).height
    if not empty:
        return []
    return [f"{counted(empty, 'more segment')} flown had no defects to find in any replicate, and no coverage."]


def _worst(world: str, means: pl.DataFrame) -> Table:
    coverage, time = metric_named("coverage"), metric_named("time_s")
    rows = tuple(
        text_cells(
            *(row["street"], row["segment"], number(row["length_m"], 0), f"{row['missions']} ({row['replicates']})"),
            f"{row['defects']}",
            *(shown(coverage, row["coverage"]), shown(time, row["time_s"])),
        )
        for row in means.head(_WORST).iter_rows(named=True)
    )
    words = f"The {_WORST} least covered segments" if means.height > _WORST else "Segments, the least covered first,"
    heads = ("Street", "Segment", "Length (m)", "Missions (replicates)", "Defects", f"Mean {heading(coverage).lower()}")
    notes: tuple[str, ...] = (
        "Missions of one replicate share their traffic and defects: what counts as evidence is the replicates.",
    )
    if any(row["defects"] < _FEW for row in means.head(_WORST).iter_rows(named=True)):
        notes += (f"A coverage of fewer than {_FEW} defects is little evidence about its segment.",)
    return Table(f"{words} of {world}", (*heads, f"Mean {heading(time).lower()}"), rows, notes=notes, merged=False)


def failures_section(study: Study) -> Section:
    failed = study.table.filter(pl.col(STATUS) == FAILED)
    reasons = Counter(failed[REASON].fill_null("no reason given").to_list()) if failed.height else Counter[str]()
    blocks: list[Block] = []
    if reasons:
        rows = tuple(
            text_cells(reason, _where(failed, reason), f"{count}")
            for reason, count in reasons.most_common(_MOST_REASONS)
        )
        rest = len(reasons) - len(rows)
        notes = (f"{counted(rest, 'more reason')} in the study's table.",) if rest else ()
        blocks = [
            (
                f"{failed.height} of {counted(study.table.height, 'mission')} failed. They count "
                "in no mean; a cell that lost many is to be read with care."
            ),
            Table("Why missions failed, and where", ("Reason", "Cells", "Missions"), rows, notes=notes, merged=False),
        ]
    return Section("failures", "Missions that failed", blocks)


def _where(failed: pl.DataFrame, reason: str) -> str:
    """`high, 15 m, hover (3); …`."""
    rows = failed.filter(pl.col(REASON).fill_null("no reason given") == reason).iter_rows(named=True)
    cells = Counter(_cell(row) for row in rows).most_common()
    words = "; ".join(f"{cell} ({count})" for cell, count in cells[:_MOST_PLACES])
    return words + (f"; and {counted(len(cells) - _MOST_PLACES, 'more cell')}" if len(cells) > _MOST_PLACES else "")


def _cell(row: Mapping[str, Any]) -> str:
    return ", ".join(level_text(axis, row[axis]) for axis in AXES)


COVERAGE: Final[Colormap] = LinearSegmentedColormap.from_list(
    "coverage", ["#46093B", "#8E2A5B", "#D05A5A", "#F09A5B", "#FBE08A"]
)
"""From little (dark) to much (light): lightness rises evenly, so that it holds in grey print."""

_THINNEST_PT, _RIM_PT, _NUMBER_PT = 2.6, 1.0, 4.6
_LONGEST_IN = 6.9


def street_means(result: pl.DataFrame, world: str) -> pl.DataFrame:
    """One row per segment: `street`, `segment`, `length_m`, `missions` with a defined coverage, `replicates`,
    `defects` (each replicate's once), `coverage`, `time_s` (means); the least covered first.
    """
    return (
        result.filter(pl.col("world") == world, pl.col("coverage").is_not_null())
        .group_by("segment", maintain_order=True)
        .agg(
            pl.col("street", "length_m").first(),
            pl.len().alias("missions"),
            pl.col("replicate").n_unique().alias("replicates"),
            pl.struct("replicate", "defects").unique().struct.field("defects").sum().alias("defects"),
            pl.col("coverage", "time_s").mean(),
        )
        .sort("coverage", "segment")
    )


def street_map(world: World, means: pl.DataFrame) -> ReportFigure | None:
    """The map of a world with its segments coloured; None when none of them is in it."""
    found = {row["segment"]: row for row in means.iter_rows(named=True)}
    segments = [segment for segment in world.segments if segment.id in found]
    if not segments:
        return None
    values = [100 * float(found[segment.id]["coverage"]) for segment in segments]
    norm = colour_range(values)
    with style.styled():
        framed = style.map_figure(
            world_bounds(world),
            title=world.name,
            subtitle="Mean coverage and number of missions of each segment",
            credit=credit(world),
            longest_in=_LONGEST_IN,
        )
        draw_world(
            framed.axes, world, layers=EVERYTHING - {MapLayer.FURNITURE, MapLayer.BASE}, defects=False, muted=True
        )
        _segments(framed.axes, segments, COVERAGE(norm(values)))
        _numbers(framed.axes, segments, found)
        _colour_bar(framed.footer, norm)
        return raster(framed.figure, _caption(world, found, segments), _alt(world, segments, values))


def colour_range(values: Sequence[float]) -> Normalize:
    """The tens around some percentages: ten of them at least, and none above 100."""
    low = min(np.floor(min(values) / 10) * 10, 90.0)
    return Normalize(float(low), float(max(np.ceil(max(values) / 10) * 10, low + 10)))


def _segments(axes: Axes, segments: Sequence[Segment], colours: Any) -> None:
    """Bands along the centre lines, as wide as the street, but wide enough to be visible, with a dark rim."""
    per_m = shapes.points_per_m(axes)
    for segment, colour in zip(segments, colours, strict=True):
        line = shapely.get_coordinates(segment.centre_line)
        width = max(segment.width_m * per_m, _THINNEST_PT)
        shapes.strokes(axes, [line], ABOVE_WORLD, style.INK, width + _RIM_PT)
        shapes.strokes(axes, [line], ABOVE_WORLD + 1, colour, width)


def _numbers(axes: Axes, segments: Sequence[Segment], found: Mapping[str, Any]) -> None:
    """Number of missions in the middle of each segment, where it fits."""
    per_m, occupied = shapes.points_per_m(axes), OccupiedSpace()
    for segment in sorted(segments, key=lambda segment: (-segment.length_m, segment.id)):
        text = f"{found[segment.id]['missions']}"
        middle = segment.centre_line.interpolate(0.5, normalized=True)
        half = (style.text_width_pt(text, _NUMBER_PT, bold=True) / 2 + 1.2) / per_m
        plate = shapely.box(middle.x - half, middle.y - 3.2 / per_m, middle.x + half, middle.y + 3.2 / per_m)
        if not occupied.free(plate):
            continue
        occupied.take(plate)
        axes.text(
            middle.x, middle.y, text, fontsize=_NUMBER_PT, fontweight="bold", ha="center", va="center_baseline",
            color=style.INK, path_effects=style.halo(1.5), zorder=ABOVE_WORLD + 3,
        )  # fmt: skip


def _colour_bar(footer: Axes, norm: Normalize) -> None:
    """Draw the colour bar in the strip below the map, whose coordinates are inches."""
    place = footer.inset_axes((0.12, footer.get_ylim()[1] - 0.26, 2.0, 0.12), transform=footer.transData)
    ticks = norm.inverse(np.linspace(0, 1, 3)).tolist()
    bar = Colorbar(place, ScalarMappable(norm, COVERAGE), orientation="horizontal", ticks=ticks, format="{x:g} %")
    bar.outline.set_visible(False)
    place.tick_params(labelsize=6, length=0, pad=2, labelcolor=style.INK)
    place.set_title("mean coverage", fontsize=6, fontweight="normal", pad=2)


def _caption(world: World, found: Mapping[str, Any], segments: Sequence[Segment]) -> str:
    missions = sum(row["missions"] for row in found.values())
    return (
        f"Mean coverage by segment in {world.name}: {counted(len(segments), 'segment')} of {len(world.segments)}, "
        f"{counted(missions, 'mission')} with a defined coverage, all cells together. The number on a segment is "
        "that of its missions. A segment is flown in all cells of its replicates and in no other, so segments differ "
        "in their traffic and defects as well as in themselves."
    )


def _alt(world: World, segments: Sequence[Segment], values: Sequence[float]) -> str:
    return (
        f"Map of {world.name} with {counted(len(segments), 'segment')} coloured by mean coverage, from "
        f"{min(values):.0f} to {max(values):.0f} %."
    )


MOST_RECORDINGS: Final = 4
"""Largest number of recordings to read for one traffic in one world."""

HEADS: Final = (
    *("World", "Traffic", "Recordings", "Mean speed (km/h)", "Of free flow", "Level of service", "Standing"),
    *("Flow (vehicles/h per lane)", "Taken out (per vehicle-hour)"),
)


def traffic_section(study: Study) -> Section:
    """Flow of the traffic of each level in its recordings; empty if none is on this machine."""
    rows = tuple(_rows(study))
    if not rows:
        return Section("traffic", "What the traffic is", [])
    words = (
        "Mean speed over the speed limits where vehicles drove is the share of free flow, whose classes are the levels "
        "of service of the Highway Capacity Manual: A above 80 %, B 67, C 50, D 40, E 30, F below. A vehicle slower "
        f"than {STANDING_MPS:g} m/s stands. Vehicles are taken out after blocking traffic for minutes; above "
        f"{MOST_REMOVALS_PER_HOUR:g} per vehicle-hour the streets are beyond capacity, and policies that wait do so "
        "for less time than they would in reality."
    )
    nearest = {name: _entry_of(study, world).get("nearest") for name, world in study.worlds.items()}
    replaced = [replaced_sentence(name, levels) for name, levels in nearest.items() if levels]
    table = Table("How the traffic flows", HEADS, rows)
    return Section("traffic", "What the traffic is", [" ".join([*replaced, words]), table])


def _rows(study: Study) -> Iterator[tuple[TableCell, ...]]:
    distance_m = None
    with suppress(PaveTwinError):
        distance_m = area_if_known(Design.parse(study.design, where="the design"))
    for name, world in study.worlds.items():
        for traffic in study.levels("traffic"):
            here = study.table.filter(world=name, traffic=traffic)["traffic_seed"].drop_nulls()
            seeds = here.unique(maintain_order=True).to_list()[:MOST_RECORDINGS]
            rows = study.by_segment.filter(world=name, traffic=traffic)
            targets = {seed: rows.filter(traffic_seed=seed)["segment"].unique().to_list() for seed in seeds}
            recordings = _recordings(_entry_of(study, world), world, traffic, targets, distance_m)
            flows = [flow_of(recording) for recording in recordings]
            if flows:
                yield text_cells(name, level_text("traffic", traffic), f"{len(flows)}", *_means(flows))


def _entry_of(study: Study, world: World) -> Mapping[str, Any]:
    """The world's entry in the design, with what is its own there; empty where nothing is."""
    own = (entry for entry in study.design.get("worlds", ()) if isinstance(entry, Mapping))
    folder = world.folder.absolute() if world.folder else None
    return next((entry for entry in own if Path(entry["path"]).absolute() == folder), {})


def _recordings(
    entry: Mapping[str, Any],
    world: World,
    traffic: str,
    targets: Mapping[int, Sequence[str]],
    distance_m: float | None,
) -> Iterator[Recording]:
    """The recordings of a level of traffic that are on this machine; not those of other routes of the same name.

    Args:
        targets: by the seed of the traffic, the segments that were inspected in it.
    """
    given = [Path(file) for file in entry.get("recordings") or () if Path(file).stem == traffic]
    if given:
        for file in filter(Path.is_file, given):
            with suppress(PaveTwinError):
                yield load_recording(file, world)
        return
    routes = entry.get("routes") or ()
    for seed, segments in targets.items():
        with suppress(PaveTwinError):
            area = None if distance_m is None else TrafficArea.around(world, segments, distance_m)
            inputs = Inputs.of(world, None if routes else traffic, seed, routes, area)
            if inputs.path.is_file() and (found := load_recording(inputs.path, world)).origin.inputs == inputs.hash:
                yield found


def _means(flows: Sequence[Flow]) -> list[str]:
    ratio = _mean([flow.ratio for flow in flows])
    return [
        _text(_mean([flow.speed_kmh for flow in flows]), "{:.0f}"),
        _text(ratio, "{:.0%}").replace("%", " %"),
        MISSING if ratio is None else str(level_of(ratio)),
        _text(_mean([flow.standing for flow in flows]), "{:.0%}").replace("%", " %"),
        _text(_mean([flow.flow_per_lane_h for flow in flows]), "{:.0f}"),
        _text(_mean([flow.removed_per_vehicle_hour for flow in flows]), "{:.2f}"),
    ]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _text(value: float | None, form: str) -> str:
    return MISSING if value is None else form.format(value)

"""The section of a report that says how the recorded traffic of each level flows."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.plan import cells_of, traffic_area_m
from pavetwin.experiments.reach import replaced_sentence
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.words import level_text
from pavetwin.reports.blocks import Section, Table, TableCell, text_cells
from pavetwin.reports.words import MISSING
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import level_of
from pavetwin.traffic.flow import MOST_REMOVALS_PER_HOUR, Flow, flow_of
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import load_recording
from pavetwin.traffic.tracks import STANDING_MPS
from pavetwin.world.model import World

MOST_RECORDINGS: Final = 4
"""Of one traffic in one world that are read."""

HEADS: Final = (
    *("World", "Traffic", "Recordings", "Mean speed (km/h)", "Of free flow", "Level of service", "Standing"),
    *("Flow (vehicles/h per lane)", "Taken out (per vehicle-hour)"),
)


def traffic_section(study: Study) -> Section:
    """How the traffic of each level flows, from its recordings; empty where none is at hand."""
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
    if "traffic_seed" not in study.table.columns:
        return
    distance_m = _area_m(study)
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


def _area_m(study: Study) -> float | None:
    """Within which distance of what is inspected traffic was recorded; None for whole towns."""
    with suppress(PaveTwinError):
        design = Design.parse(study.design, where="the design")
        return traffic_area_m(design, cells_of(design))
    return None


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

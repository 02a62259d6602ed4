"""The images of plans: one that was exported, read back, over the simulated track; and the page of a handover.

python -m gallery.flight_plan missions/monday
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
import shapely
from matplotlib.figure import Figure

from pavetwin.draw import shapes, style
from pavetwin.draw.mission_map import name_streets
from pavetwin.draw.world_map import ABOVE_WORLD, MapLayer, credit, draw_world
from pavetwin.flightplan import PLAN_FORMATS, save_plan
from pavetwin.handover import Handover, handover_of
from pavetwin.handover.map import map_bounds
from pavetwin.handover.page import page_of
from pavetwin.handover.sheet import sheet_figure
from pavetwin.mission.folder import MissionFolder, mission_file
from pavetwin.world.georeference import from_wgs84

WAYPOINT = 16
"""MAVLink's command."""

TRACK, PLAN, INSPECTED = "#F0B64A", "#1F3A5F", "#CFE2EF"
_LAYERS = frozenset({MapLayer.BUILDINGS, MapLayer.CARRIAGEWAYS, MapLayer.SIDEWALKS})


def read_back(handover: Handover) -> list[np.ndarray]:
    """The waypoints (n, 2) of each flight, east and north in metres, from QGroundControl files as they are written."""
    place = handover.world.georeference
    with TemporaryDirectory() as folder:
        files = save_plan(handover.plan, Path(folder), [PLAN_FORMATS.get("qgc")()])
        items = [json.loads(file.read_text())["mission"]["items"] for file in files]
    lonlat = [
        [(each["params"][5], each["params"][4]) for each in some if each["command"] == WAYPOINT] for some in items
    ]
    return [from_wgs84(place, each) for each in lonlat]


def plan_figure(handover: Handover, flights: Sequence[np.ndarray]) -> Figure:
    """Draw within `style.styled`."""
    track = pl.read_parquet(handover.mission.path.parent / "track.parquet", columns=["x_m", "y_m"]).to_numpy()
    away_m = shapely.distance(shapely.MultiLineString([*flights]), shapely.points(track)).max()
    legend = [
        style.LegendEntry("simulated track", "line", TRACK, size_pt=4.0),
        style.LegendEntry("exported plan, read back", "line", PLAN, size_pt=0.9),
        style.LegendEntry("waypoint", "o", PLAN, size_pt=3.0),
        style.LegendEntry("inspected segment", "patch", INSPECTED),
    ]
    words = f"{sum(map(len, flights))} waypoints; the track is within {100 * away_m:.0f} cm of the plan"
    framed = style.map_figure(
        map_bounds(handover),
        title=f"{handover.world.name}: an exported plan over the track it came from",
        subtitle=words,
        credit=credit(handover.world),
        legend=legend,
        longest_in=7.0,
    )
    axes = framed.axes
    draw_world(axes, handover.world, bounds=map_bounds(handover), layers=_LAYERS, defects=False, muted=True)
    segments = {condition.unit.segment.id: condition.unit.segment for condition in handover.condition.true}
    shapes.fill(axes, [each.polygon for each in segments.values()], 9, INSPECTED, style.CASING, 0.3)
    name_streets(axes, handover.world, segments)
    shapes.strokes(axes, [track], ABOVE_WORLD, TRACK, 4.0)
    for xy in flights:
        shapes.strokes(axes, [xy], ABOVE_WORLD + 1, PLAN, 0.9)
        axes.scatter(*xy.T, s=6, color=PLAN, zorder=ABOVE_WORLD + 2, linewidths=0)
    return framed.figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", type=Path, help="folder of a mission")
    parser.add_argument("--output", type=Path, default=Path("docs/images"), help="folder of the pictures")
    given = parser.parse_args()
    handover = handover_of(MissionFolder(mission_file(given.mission)))
    with style.styled():
        style.save_figure(plan_figure(handover, read_back(handover)), given.output / "plan.png")
        page = page_of(handover, credit(handover.world) or "")
        style.save_figure(sheet_figure(page, handover), given.output / "handover.png")


if __name__ == "__main__":
    main()

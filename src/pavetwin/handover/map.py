"""The map of a handover: the condition as found, the flights of the plan, defects found and missed, the take-off."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.draw import shapes, style
from pavetwin.draw.condition_maps import pci_shades
from pavetwin.draw.mission_map import name_streets
from pavetwin.draw.style import LegendEntry
from pavetwin.draw.world_map import ABOVE_WORLD, MapLayer, base_symbol, draw_world
from pavetwin.flightplan import PlannedFlight
from pavetwin.handover.contents import Handover
from pavetwin.world.georeference import GeoReference, from_wgs84
from pavetwin.world.ground import Bounds

AROUND_M: Final = 25.0
"""Ground that is shown around what is inspected and flown."""

FLIGHTS: Final = ("#1F3A5F", "#7A2E8C", "#8A4B00", "#006D77", "#A3195B", "#3F5B00")
"""Colours of the flights, in turn."""

_LAYERS: Final = frozenset({MapLayer.PARKS, MapLayer.BUILDINGS, MapLayer.SIDEWALKS, MapLayer.CARRIAGEWAYS})
_CONDITION: Final = 9.0  # Above buildings and their shadows, below the names of streets
_WAY: Final = ABOVE_WORLD - 12.0
_PASS_PT, _WAY_PT = 1.1, 0.7


def map_bounds(handover: Handover) -> Bounds:
    """Bounds of the map in metres of the world frame."""
    world = handover.world
    shown: list[shapely.Geometry] = [condition.unit.polygon for condition in handover.condition.true]
    shown += [shapely.MultiPoint(from_wgs84(world.georeference, flight.lonlat)) for flight in handover.plan.flights]
    west, south, east, north = (float(value) for value in shapely.total_bounds(shown))
    return west - AROUND_M, south - AROUND_M, east + AROUND_M, north + AROUND_M


def draw_map(axes: Axes, handover: Handover) -> None:
    """Draw the map into axes, which it fills."""
    world, found = replace(handover.world, base=_take_off(handover)), handover.condition.found
    assert found is not None
    draw_world(axes, world, bounds=map_bounds(handover), layers=_LAYERS, defects=False, muted=True)
    name_streets(axes, world, {condition.unit.segment.id for condition in found})
    for shade in pci_shades(found):
        shapes.fill(axes, list(shade.surfaces), _CONDITION, shade.colour, style.CASING, 0.3)
    for number, flight in enumerate(handover.plan.flights):
        draw_flight(axes, flight, world.georeference, FLIGHTS[number % len(FLIGHTS)])
    _draw_defects(axes, handover)
    base_symbol(axes, world, zorder=ABOVE_WORLD)


def _take_off(handover: Handover) -> shapely.Point:
    """In the world frame: that of the mission, which need not be the world's own."""
    return shapely.Point(from_wgs84(handover.world.georeference, handover.plan.flights[0].lonlat[0]))


def draw_flight(axes: Axes, flight: PlannedFlight, place: GeoReference, colour: str) -> None:
    """The legs of a flight: whole where the camera is on, dashed on the way."""
    xy = from_wgs84(place, flight.lonlat)
    legs = list(zip(np.stack([xy[:-1], xy[1:]], axis=1), flight.waypoints[:-1], strict=True))
    passes = [leg for leg, begin in legs if begin.photographs]
    way = [leg for leg, begin in legs if not begin.photographs]
    shapes.strokes(axes, passes, _WAY + 1, colour, _PASS_PT)
    shapes.strokes(axes, way, _WAY, colour, _WAY_PT, (2.5, 1.8))


def _draw_defects(axes: Axes, handover: Handover) -> None:
    outcomes = np.array(handover.defects["outcome"].to_list())
    places = np.array([(each.centre.x, each.centre.y) for each in handover.shapes]).reshape(-1, 2)
    size = float(np.clip(9.0 * shapes.points_per_m(axes), 5.0, 16.0))
    for level, name in enumerate(("missed", "found")):
        spots = places[outcomes == name]
        axes.scatter(
            spots[:, 0], spots[:, 1], s=size, marker=style.OUTCOME_MARKERS[name], color=style.OUTCOME_COLOURS[name],
            edgecolors=style.PAPER, linewidths=0.02 * size, zorder=ABOVE_WORLD - 8 + level,
        )  # fmt: skip


def legend_of(handover: Handover) -> Sequence[LegendEntry]:
    """Legend of the marks that are on the map."""
    found = handover.condition.found
    assert found is not None
    entries = [
        LegendEntry(f"PCI, found: {shade.label}", "patch", shade.colour, style.CASING)
        for shade in pci_shades(found)
        if shade.surfaces
    ]
    for name, count in (("found", handover.found), ("missed", handover.missed)):
        if count:
            marker, colour = style.OUTCOME_MARKERS[name], style.OUTCOME_COLOURS[name]
            entries.append(LegendEntry(f"defect {name} ({count})", marker, colour, size_pt=4.5))
    flights = range(len(handover.plan.flights))
    entries += [
        LegendEntry(
            f"flight {number + 1 if len(flights) > 1 else ''} (dashed: camera off)".replace("  ", " "),
            "line",
            FLIGHTS[number],
            size_pt=1.6,
        )
        for number in flights[: len(FLIGHTS)]
    ]
    return [*entries, LegendEntry("take-off and landing", "o", style.BASE, size_pt=6.5)]


def map_figure(handover: Handover, credit: str) -> Figure:
    """The map alone, for the page in HTML; draw it within `style.styled`."""
    framed = style.map_figure(
        map_bounds(handover),
        title=f"{handover.world.name}: flights and condition as found",
        subtitle="Flights are whole lines where the camera is on, dashed on the way",
        credit=credit or None,
        legend=legend_of(handover),
        longest_in=7.0,
    )
    draw_map(framed.axes, handover)
    return framed.figure

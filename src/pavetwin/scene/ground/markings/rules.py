"""Rules of road markings: sizes after two countries' standards, chosen by the world's location."""

from dataclasses import dataclass
from typing import Final

from pavetwin.world.model import World


@dataclass(frozen=True)
class MarkingRules:
    """Sizes in metres; dashes as (painted, free)."""

    name: str
    line_m: float
    """Width of lane and centre lines."""
    broad_m: float
    """Width of lines beside bicycle lanes."""
    lane_dash_m: tuple[float, float]
    yellow_centre: bool
    double_gap_m: float
    """Between the two lines of a double centre line."""
    stop_m: float
    """Width of a stop line."""
    yield_dash_m: tuple[float, float] | None
    """Of a give-way line as wide as a stop line; None for triangles."""
    stripe_m: tuple[float, float]
    """Of a zebra crossing: painted, free."""
    ladder_share: float
    """Share of signalled crossings painted as stripes; the others have two lines."""
    crossing_line_m: float
    crossing_dash_m: tuple[float, float] | None
    """Of the two lines of a signalled crossing; None for solid ones."""


EUROPE: Final = MarkingRules(
    name="europe",
    line_m=0.12,
    broad_m=0.25,
    lane_dash_m=(3.0, 6.0),
    yellow_centre=False,
    double_gap_m=0.12,
    stop_m=0.50,
    yield_dash_m=(0.50, 0.25),
    stripe_m=(0.50, 0.50),
    ladder_share=0.25,
    crossing_line_m=0.12,
    crossing_dash_m=(0.50, 0.20),
)
"""Germany: Richtlinien für die Markierung von Straßen (RMS-1, 1993): Schmalstrich 0.12 m in towns, 3 m and 6 m for lane
lines, stop line (Zeichen 294) 0.50 m, give-way line (341) 0.50 m and 0.25 m, zebra (293) 0.50 m and 0.50 m."""

AMERICA: Final = MarkingRules(
    name="america",
    line_m=0.10,
    broad_m=0.15,
    lane_dash_m=(3.05, 9.14),
    yellow_centre=True,
    double_gap_m=0.10,
    stop_m=0.45,
    yield_dash_m=None,
    stripe_m=(0.60, 0.60),
    ladder_share=0.6,
    crossing_line_m=0.30,
    crossing_dash_m=None,
)
"""United States: MUTCD 2009, part 3: normal lines 4 to 6 in, broken lines 10 ft and 30 ft (3A.06), yellow between
directions (3A.05), stop lines 12 to 24 in and yield triangles 12 × 18 in up to 24 × 36 in (3B.16), crosswalk lines 6 to
24 in, longitudinal bars 12 to 24 in (3B.18)."""


def rules_of(world: World) -> MarkingRules:
    """The marking rules of a world's location."""
    if not world.segments:
        return EUROPE
    longitude, latitude = world.georeference.to_wgs84(world.segments[0].centre_line.coords[0])
    return AMERICA if -170 < longitude < -50 and 14 < latitude < 75 else EUROPE

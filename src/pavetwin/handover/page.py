"""The page of a handover as plain values: numbers, sentences and tables, the same for PDF and HTML."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import polars as pl

from pavetwin.defects.placement import PLACED
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.handover.contents import Handover
from pavetwin.mission.environment import capture_interval_s, inspect_speed_mps
from pavetwin.mission.inspected_defects import missed_words
from pavetwin.mission.metrics import found_share
from pavetwin.pci import rating_of
from pavetwin.policies import Pilot, policy_class, policy_names
from pavetwin.reports.words import MISSING, counted, listed, number, percent
from pavetwin.traffic.demand import density_named
from pavetwin.uav import camera_of
from pavetwin.uav.aircraft import aircraft_of, camera_name

PILOT: Final = (
    "The pilot is responsible for the flight: check the plan, the airspace, the permits and the people below, keep the "
    "aircraft in sight and be ready to take over. Heights are above the take-off point; the ground is assumed to be "
    "level "
    "and obstacles as mapped, so that wires and trees may be missing."
)


_WORDS: Final = ("rating of that", "recommended")  # Heads of columns that hold words


@dataclass(frozen=True)
class PageTable:
    """Rows under their heads; the first column is text."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def is_words(self, column: int) -> bool:
        """True if a column holds no numbers."""
        return column == 0 or self.heads[column] in _WORDS


@dataclass(frozen=True)
class Paragraphs:
    title: str
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Page:
    title: str
    subtitle: str
    numbers: tuple[tuple[str, str], ...]
    """Main numbers: names and values."""
    paragraphs: tuple[Paragraphs, ...]
    tables: tuple[PageTable, ...]
    credit: str


def page_of(handover: Handover, credit: str) -> Page:
    """The page of a handover.

    Args:
        credit: whom the world's data come from.
    """
    mission = handover.mission
    spec = mission.spec
    return Page(
        title=f"{handover.world.name}: pavement inspection by drone",
        subtitle=f"Handover of {handover.name}, simulated with PaveTwin {spec.versions['pavetwin']}",
        numbers=tuple(_numbers(handover)),
        paragraphs=(
            Paragraphs("When and how to fly", tuple(_flight(handover))),
            Paragraphs("Pilots for the policy", tuple(_pilots(handover))),
            Paragraphs("What will be seen", tuple(_seen(handover))),
            Paragraphs("What will not be seen", tuple(_unseen(handover))),
            Paragraphs("Responsibility", (PILOT,)),
        ),
        tables=(_severities(handover), _streets(handover)),
        credit=credit,
    )


def _numbers(handover: Handover) -> Iterator[tuple[str, str]]:
    totals = handover.mission.totals
    spec, flights = handover.mission.spec, handover.plan.flights
    yield "Height above take-off", f"{spec.settings.altitude_m:g} m"
    yield "Policy", handover.policy
    yield "Batteries to bring", f"{len(flights)}"
    yield "Time, simulated", f"{totals['time_s'] / 60:.0f} min"
    yield "Defects found", f"{handover.found} of {handover.defects.height}"
    yield "PCI, as found", f"{handover.pci_found:.0f} (true: {handover.condition.pci:.0f})"


def _flight(handover: Handover) -> Iterator[str]:
    settings, totals, plan = handover.mission.spec.settings, handover.mission.totals, handover.plan
    weather, longitude = settings.conditions, plan.flights[0].home.longitude
    yield (
        f"On {weather.date:%-d %B %Y} at {weather.time:%H:%M} mean solar time ({weather.utc(longitude):%H:%M} UTC), "
        f"{_sky(weather.clouds)}, {_wind(weather.wind_mps, weather.wind_from_deg)}, {_traffic(handover)}."
    )
    aircraft = aircraft_of(settings)
    flown_by = f"{aircraft.title}, camera" if aircraft else "Camera"
    pixel_mm = 1000 * camera_of(settings).ground_resolution_m(settings.altitude_m)
    yield (
        f"{flown_by} {camera_name(settings)}, straight down: {settings.altitude_m:g} m above take-off, "
        f"{inspect_speed_mps(settings):g} m/s on inspected legs, a photograph every {plan.spacing_m:.2g} m "
        f"({capture_interval_s(settings):g} s), {pixel_mm:.1f} mm of road a pixel."
    )
    km = sum(flight.distance_m for flight in plan.flights) / 1000
    home = plan.flights[0].home
    each = "each " if len(plan.flights) > 1 else ""
    yield (
        f"{counted(len(plan.flights), 'flight')} from {home.latitude:.6f}, {home.longitude:.6f}, {km:.1f} km, "
        f"{each}with a full battery: simulated {totals['time_s'] / 60:.1f} min with "
        f"{number(100 * totals['energy'], 0)} % of a battery, {totals['wait_s']:.0f} s of waiting included."
    )
    yield from plan.remarks


def _sky(clouds: float) -> str:
    return "overcast" if clouds > 0.85 else "partly cloudy" if clouds > 0.3 else "a clear sky"


def _wind(speed_mps: float, from_deg: float) -> str:
    return f"wind of {speed_mps:g} m/s from {from_deg:.0f}°" if speed_mps else "no wind"


def _traffic(handover: Handover) -> str:
    density = handover.mission.spec.traffic.density
    level = None if density is None else density_named(density).level
    if level is not None:
        return f"in traffic of level of service {level}"
    return "in the traffic of routes or a recording" if density is None else f"in {density} traffic"


def _pilots(handover: Handover) -> Iterator[str]:
    """Sentences on the pilot of the mission's policy, then of the others."""
    policy = policy_class(handover.mission.spec.policy.name)
    own = policy.pilot
    yield f"{policy.name}: {own}. {policy.by_hand}".strip()
    others = [name for name in policy_names() if name != handover.policy]
    by_pilot = {pilot: [name for name in others if policy_class(name).pilot is pilot] for pilot in Pilot}
    named = [f"{listed(names)} ({pilot})" for pilot, names in by_pilot.items() if names]
    yield f"Other policies: {'; '.join(named)}."
    if own is not Pilot.ANY:
        yield "The plans hold the route without reactions to traffic: what the policy adds is done by hand."


def _seen(handover: Handover) -> Iterator[str]:
    totals = handover.mission.totals
    surface = totals["surface_coverage"]
    hidden = totals.get("permanently_hidden")
    parked = f" (parked vehicles hide {percent(hidden)} permanently)" if hidden else ""
    yield f"{percent(surface)} of the surface of {counted(handover.streets.height, 'street')}{parked}."
    share = found_share(*handover.by_segment)
    if share is None:
        yield "There are no defects on these streets."
        return
    low, high = (number(100 * value, 0) for value in (share.low, share.high))
    yield (
        f"{handover.found} of {counted(handover.defects.height, 'defect')}, {percent(share.share)} ({low} to {high} % "
        "on streets like these)."
    )
    if alarms := totals.get("false_alarms"):
        yield f"{counted(alarms, 'report')} of the sensor {'is' if alarms == 1 else 'are'} false."
    gap = handover.pci_found - handover.condition.pci
    yield (
        f"The Pavement Condition Index (ASTM D6433) of the found defects is {handover.pci_found:.1f}, "
        f"{rating_of(handover.pci_found)}; the true one is {handover.condition.pci:.1f}, "
        f"{rating_of(handover.condition.pci)}: "
        f"{abs(gap):.1f} points {'more' if gap >= 0 else 'less'}."
    )
    if (detected := handover.condition.pci_detected) is not None:
        yield (
            f"Computed from the sensor's measurements with false alarms, it is {detected:.1f}, {rating_of(detected)}."
        )


def _unseen(handover: Handover) -> Iterator[str]:
    if handover.missed:
        yield f"{counted(handover.missed, 'defect')}: {missed_words(handover.reasons)}."
    else:
        yield "No defect on these streets is missed."
    yield f"Defects are {PLACED}: the numbers show what such a flight finds, not what is on the road today."
    if left_out := sum(handover.condition.not_counted.values()):
        yield f"{counted(left_out, 'defect')} of classes without a distress of the standard are not in the index."


def _severities(handover: Handover) -> PageTable:
    rows = [
        (f"{row['class'].replace('_', ' ')}, {row['severity']}", *(f"{row[key]}" for key in ("defects", "found")))
        + (f"{row['missed']}",)
        for row in handover.by_severity().iter_rows(named=True)
    ]
    rows.append(("all", f"{handover.defects.height}", f"{handover.found}", f"{handover.missed}"))
    return PageTable("Defects by severity", ("class, severity", "defects", "found", "missed"), tuple(rows))


def _streets(handover: Handover) -> PageTable:
    advice = handover.advice
    heads = ["street", "length m", "surface seen %", "defects found", "PCI, true", "PCI, found", "rating of that"]
    heads += ["recommended", "found % there"] if advice else []
    rows = []
    for row in handover.streets.iter_rows(named=True):
        cells = [row["street"], f"{row['length_m']:.0f}", f"{100 * row['surface_coverage']:.0f}"]
        cells += [f"{row['found']} of {row['defects']}", f"{row['pci']:.1f}", f"{row['pci_found']:.1f}"]
        cells.append(row["rating_found"])
        if advice:
            expected = row["expected_coverage"]
            cells += [row["fly"] or MISSING, MISSING if expected is None else f"{100 * expected:.0f}"]
        rows.append(tuple(cells))
    return PageTable("Streets, the worst first", tuple(heads), tuple(rows), " ".join(_advice(handover)))


def _advice(handover: Handover) -> Iterator[str]:
    if (advice := handover.advice) is None:
        return
    own = advice.table.filter(**{"from": "this street"})["street"].to_list()
    yield f"The study {advice.study}: {advice.overall.sentences[0]}"
    yield (
        f"Missions there show that another option is better for {listed(own)}."
        if own
        else "No street's own missions show that another option is better there."
    )
    if few := advice.table.filter(pl.col("replicates") < FEW).height:
        yield f"{counted(few, 'street has', 'streets have')} fewer than {FEW} replicates, too few for own advice."

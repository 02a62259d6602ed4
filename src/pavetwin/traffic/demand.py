"""Demand: a density, a level of service, an hour of a weekday or a user's own routes, and the mix of vehicles.

A density is vehicles per kilometre of lane and pedestrians per kilometre of sidewalk. The denominators are the lengths
of all driving lanes and of all sidewalks, between junctions. Agents on junctions and crossings count in the numerator.
The density of a level of service or of an hour depends on the world: see `demand_search`.

A level of service describes traffic flow by the share of the free-flow speed that it keeps. The classes are those of
the Highway Capacity Manual (HCM, 6th edition, chapters 16 and 18) for motor vehicles on urban streets, by travel speed
over base free-flow speed. The edition of 2010 has 85 % instead of 80 % for A. A mix is a YAML file of `mixes`.
"""

import gzip
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, Self
from xml.etree import ElementTree

import yaml
from pydantic import Field, model_validator

from pavetwin.config.named import names_in
from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import file_sha256
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS, VEHICLES, Kind
from pavetwin.world.model import LaneKind, World
from pavetwin.world.osm_file import suffix_of_content


class LevelOfService(StrEnum):
    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"

    @property
    def above(self) -> float:
        """The speed ratio is above this."""
        return _ABOVE[self]

    @property
    def up_to(self) -> float:
        """The speed ratio is at most this; infinite for A, since drivers may exceed the limit."""
        better = list(LevelOfService)[: list(LevelOfService).index(self)]
        return better[-1].above if better else float("inf")

    def holds(self, ratio: float) -> bool:
        return self.above < ratio <= self.up_to

    def target(self, reachable: float) -> float:
        """The speed ratio in the middle of the class, or of the part of it that a network can reach; in F above it.

        Args:
            reachable: the speed ratio of the nearly empty network.
        """
        share = STOP_AND_GO if self is LevelOfService.F else 0.5
        return self.above + share * (min(self.up_to, reachable, 1.0) - self.above)


STOP_AND_GO: Final = 2 / 3
"""Target of F, which ends at standstill. At its middle, a speed ratio of 0.15, traffic falls into gridlock
in some towns, and no number of vehicles holds it."""

_ABOVE: Final = {"A": 0.80, "B": 0.67, "C": 0.50, "D": 0.40, "E": 0.30, "F": 0.0}


def level_of(ratio: float) -> LevelOfService:
    """The class of a speed ratio, 0 … 1 and above. Standing traffic is F."""
    return next((level for level in LevelOfService if ratio > level.above), LevelOfService.F)


def level_named(name: str) -> LevelOfService:
    """The level of service called `name`.

    Raises:
        PaveTwinError: there is no such level.
    """
    if name.upper() not in LevelOfService.__members__:
        raise PaveTwinError(no_such("level of service", name, LevelOfService, key="`los`"))
    return LevelOfService(name.upper())


DEFAULT_MIX: Final = "europe"
"""The kinds and shares of `kinds.VEHICLES`."""


class Mix(Settings):
    """Contents of the file of a mix."""

    what: str
    """Short description."""
    sources: tuple[str, ...]
    """Source of the shares."""
    ours: str
    """Shares that are assumptions of ours."""
    shares: Mapping[str, Annotated[float, Field(gt=0, le=1)]]
    """Kind → share of all vehicles; they sum to 1."""

    @model_validator(mode="after")
    def _of_known_kinds(self) -> Self:
        if unknown := [name for name in self.shares if name not in KINDS]:
            raise ValueError(f"unknown kind of vehicle '{unknown[0]}'")
        if abs(sum(self.shares.values()) - 1.0) > 1e-9:
            raise ValueError(f"the shares sum to {sum(self.shares.values()):g}, not to 1")
        return self

    @property
    def vehicles(self) -> tuple[tuple[Kind, float], ...]:
        """Kinds and their shares."""
        return tuple((KINDS[name], share) for name, share in self.shares.items())


def mix_names() -> list[str]:
    """The mixes that ship with the package, the default first."""
    return sorted(names_in("pavetwin.traffic", "mixes"), key=lambda name: (name != DEFAULT_MIX, name))


@cache
def mix_named(name: str) -> Mix:
    """The mix called `name`.

    Raises:
        PaveTwinError: there is no such mix; the message gives the nearest name.
    """
    if name not in mix_names():
        raise PaveTwinError(no_such("mix of vehicles", name, mix_names(), key="`mix`"))
    text = (files("pavetwin.traffic") / "mixes" / f"{name}.yaml").read_text(encoding="utf-8")
    return Mix.parse(yaml.safe_load(text), where=f"the mix '{name}'")


def kinds_of(name: str) -> Iterator[Kind]:
    """The kinds that SUMO must know for a mix: those of the default mix, people, and what else the mix has."""
    yield from VEHICLES
    yield from PEDESTRIANS
    yield from (kind for kind, _ in mix_named(name).vehicles if kind not in VEHICLES)


TOLERANCE: Final = 0.20
"""A larger relative error of the achieved density becomes a remark."""

JAM_VEHICLES_PER_LANE_KM: Final = 133.0
"""One vehicle every 7.5 m (SUMO's 5 m car and 2.5 m gap): more cannot stand on a lane."""

USER: Final = "user"
"""The name of the density of a user's own routes."""


MIXED: Final = "+"
"""Before the mix in a name, where it is not the default one: `high+south_asia`."""

_LEVEL: Final = "los-"
_HOUR: Final = "hour-"

DEFAULT_TRAFFIC: Final = f"{_LEVEL}{LevelOfService.C}"
"""Density of missions and datasets that name none."""

LEVEL_PEDESTRIANS: Final = 60.0
"""Per kilometre of sidewalk in every level of service, and in the busiest hour: those of the density medium. The
Highway Capacity Manual grades vehicles only."""

HOURLY_SHARES: Final = (
    *(0.8, 0.5, 0.4, 0.3, 0.4, 1.2, 4.5, 7.4, 6.6, 5.2, 5.0, 5.0),
    *(5.2, 5.3, 5.6, 6.7, 8.4, 8.6, 7.4, 5.0, 3.9, 3.0, 2.1, 1.6),
)
"""Percent of a day's cars in each hour from 0 to 23 o'clock, Tuesday to Thursday, at the edge of the inner cities of
West Germany: Schmidt and Thomas 1996 (Forschung Straßenbau und Straßenverkehrstechnik 732), p. 95, as the SUMO
documentation has it (`TGw2_PKW`)."""

SEARCH: Final = 1
"""Version of the demand of a level of service or an hour, and of the search for it (`demand_search`)."""

HOURS: Final = 1
"""Version of how the demand of an hour follows from that of the busiest one (`demand_search`)."""

BUSIEST: Final = LevelOfService.D
"""Level of the busiest hour. An assumption of ours: streets are built to work at capacity's edge on a usual weekday."""


@dataclass(frozen=True, slots=True)
class Density:
    """Mean numbers of agents per kilometre, and a name for files, which holds the rest."""

    name: str
    vehicles_per_lane_km: float | None
    """Density; None for a level of service or an hour whose density in a world is not found yet."""
    pedestrians_per_sidewalk_km: float

    def __post_init__(self) -> None:
        for what, value in (
            ("vehicles per lane-kilometre", self.vehicles_per_lane_km),
            ("pedestrians per sidewalk-kilometre", self.pedestrians_per_sidewalk_km),
        ):
            if value is not None and (not math.isfinite(value) or value < 0):
                raise PaveTwinError(f"The density of {what} must be a number from 0 up, not {value:g}.")
        if self.vehicles_per_lane_km is not None and self.vehicles_per_lane_km > JAM_VEHICLES_PER_LANE_KM:
            raise PaveTwinError(
                f"{self.vehicles_per_lane_km:g} vehicles per lane-kilometre do not fit on a lane: bumper to bumper "
                f"there are {JAM_VEHICLES_PER_LANE_KM:g}. Choose a density below that."
            )

    @property
    def level(self) -> LevelOfService | None:
        """The requested level of service."""
        name = self._base
        return LevelOfService(name.removeprefix(_LEVEL)) if name.startswith(_LEVEL) else None

    @property
    def hour(self) -> int | None:
        """The requested hour of a weekday, 0 … 23."""
        name = self._base
        return int(name.removeprefix(_HOUR)) if name.startswith(_HOUR) else None

    @property
    def is_found(self) -> bool:
        """Whether its density is found by closed loop, and not given as a number."""
        return self.level is not None or self.hour is not None

    @property
    def mix(self) -> str:
        """Name of the mix of vehicles."""
        return self.name.partition(MIXED)[2] or DEFAULT_MIX

    @property
    def _base(self) -> str:
        return self.name.partition(MIXED)[0]


DENSITIES: Final[Mapping[str, Density]] = MappingProxyType(
    {density.name: density for density in (Density("low", 6, 20), Density("medium", 15, 60), Density("high", 30, 120))}
)
"""The three densities of the design's section 4."""


_NUMBERS: Final = re.compile(r"v(\d+(?:\.\d+)?)-p(\d+(?:\.\d+)?)")


def density_named(name: str, mix: str = "") -> Density:
    """The traffic called `name`: one of `DENSITIES`, numbers as `density_of` names them (`v12-p40`), a level of service
    (`los-C`) or an hour of a weekday (`hour-08`); each with a mix behind a plus sign (`los-C+south_asia`).

    Args:
        mix: a mix's name, where the traffic's name has none.

    Raises:
        PaveTwinError: there is none; the message gives the nearest name.
    """
    base, _, own = name.partition(MIXED)
    if own and mix and own != mix:
        raise PaveTwinError(f"`mix` {mix}: the traffic '{name}' has the mix {own}; give one of them.")
    found, mix = _without_mix(base), own or mix or DEFAULT_MIX
    mix_named(mix)
    return found if mix == DEFAULT_MIX else replace(found, name=f"{found.name}{MIXED}{mix}")


def _without_mix(name: str) -> Density:
    if name in DENSITIES:
        return DENSITIES[name]
    if name.startswith(_LEVEL):
        return level_density(name.removeprefix(_LEVEL))
    if name.startswith(_HOUR):
        return hour_density(name.removeprefix(_HOUR))
    if numbers := _NUMBERS.fullmatch(name):
        return density_of(float(numbers[1]), float(numbers[2]))
    form = "v12-p40 is 12 vehicles per kilometre of lane and 40 pedestrians per kilometre of sidewalk"
    known = (*DENSITIES, *(f"{_LEVEL}{level}" for level in LevelOfService), f"{_HOUR}08")
    raise PaveTwinError(no_such("density", name, known, key="`density`", instead=f", or numbers: {form}"))


def density_of(vehicles_per_lane_km: float, pedestrians_per_sidewalk_km: float) -> Density:
    """A density of the user's own numbers, named after them (`v12-p40`)."""
    name = f"v{vehicles_per_lane_km:g}-p{pedestrians_per_sidewalk_km:g}"
    return Density(name, vehicles_per_lane_km, pedestrians_per_sidewalk_km)


def level_density(level: str) -> Density:
    """The traffic of a level of service, A to F, whose density is not found yet.

    Raises:
        PaveTwinError: there is no such class.
    """
    return Density(f"{_LEVEL}{level_named(level)}", None, LEVEL_PEDESTRIANS)


def hour_density(hour: str | int) -> Density:
    """The traffic of an hour of a weekday, 0 to 23, whose density is not found yet.

    Raises:
        PaveTwinError: there is no such hour.
    """
    number = int(hour) if str(hour).isdecimal() else -1
    if not 0 <= number < len(HOURLY_SHARES):
        raise PaveTwinError(f"`hour` {hour}: expected a whole number from 0 to 23.")
    return Density(f"{_HOUR}{number:02}", None, LEVEL_PEDESTRIANS * share_of_busiest(number))


def share_of_busiest(hour: int) -> float:
    """The traffic of an hour, as a share of that of the busiest one."""
    return HOURLY_SHARES[hour] / max(HOURLY_SHARES)


@dataclass(frozen=True, slots=True)
class Capacity:
    """The denominators of the density in one world or area, in kilometres."""

    lanes_km: float
    sidewalks_km: float

    @classmethod
    def of(cls, world: World, area: TrafficArea | None = None) -> "Capacity":
        if area is not None:
            return cls(area.length_km(world), area.length_km(world, LaneKind.SIDEWALK))
        return cls(world.length_km(LaneKind.DRIVING), world.length_km(LaneKind.SIDEWALK))

    def vehicles(self, density: Density) -> int:
        """Number of vehicles of the density; at least one where any were asked for and a lane exists."""
        if density.vehicles_per_lane_km is None:
            raise ValueError(f"The density of {density.name} is not found yet")
        return _count(density.vehicles_per_lane_km * self.lanes_km)

    def pedestrians(self, density: Density) -> int:
        """Number of pedestrians of the density; none in a world without sidewalks."""
        return _count(density.pedestrians_per_sidewalk_km * self.sidewalks_km)


def _count(expected: float) -> int:
    return 0 if expected <= 0 else max(1, round(expected))


WARM_UP_S: Final = 300.0
"""Default time of take-off after the first departure; missions take off with the last departure where that is
earlier. As long as the longest warm-up of a density."""

FLOWS: Final = frozenset({"flow", "personFlow"})
WHO: Final = FLOWS | {"vehicle", "trip", "person"}
"""Elements of a route file that put someone on the streets."""

_KINDS: Final = {
    "osm": "an OpenStreetMap map",
    "net": "a SUMO network",
    "nodes": "a list of SUMO's nodes",
    "edges": "a list of SUMO's edges",
    "fcd-export": "an output of SUMO (positions)",
    "tripinfos": "an output of SUMO (trips)",
}
"""Kinds of XML files, by their root."""


@dataclass(frozen=True, slots=True)
class OwnDemand:
    """The departures of a user's demand, on SUMO's clock."""

    first_s: float
    last_s: float
    """Infinite where a flow has no stated end."""

    @property
    def begin_s(self) -> float:
        """Start of SUMO: the first departure, in whole seconds."""
        return float(math.floor(self.first_s))

    @property
    def warm_up_s(self) -> float:
        """Default take-off of missions, in whole seconds after `begin_s`."""
        return float(math.floor(min(WARM_UP_S, self.last_s - self.begin_s)))


def own_demand(routes: Sequence[str | Path]) -> OwnDemand:
    """The demand of SUMO route files, plain or gzipped.

    Raises:
        PaveTwinError: a file is missing, no XML, or holds no vehicle; the message names the kind of file.
    """
    each = []
    for path in map(Path, routes):
        if not path.is_file():
            raise PaveTwinError(f"There is no routes file '{path}'.")
        each.append(_read(path, file_sha256(path)))
    return OwnDemand(min(one.first_s for one in each), max(one.last_s for one in each))


@lru_cache(maxsize=16)
def _read(path: Path, _content: str) -> OwnDemand:
    first, last = math.inf, 0.0
    agents, root = 0, ""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            for event, element in ElementTree.iterparse(file, ("start", "end")):
                if event == "start":
                    root = root or element.tag
                    if root in _KINDS:
                        break
                    continue
                if element.tag in WHO:
                    agents += 1
                    end = element.get("end" if element.tag in FLOWS else "depart")
                    with suppress(ValueError):
                        last = max(last, _seconds(end or "inf"))
                with suppress(ValueError):
                    first = min(first, _seconds(element.get("depart") or element.get("begin") or ""))
                element.clear()
    except (ElementTree.ParseError, EOFError, OSError) as error:
        kind = _binary_kind(path)
        raise PaveTwinError(
            f"'{path}' is {kind}, not a routes file of SUMO."
            if kind
            else f"The routes file '{path}' is not valid XML: {error}."
        ) from error
    if not agents:
        kind = _KINDS.get(root, f"XML with the root <{root}>")
        what = f"is {kind}, not a routes file of SUMO: it" if root != "routes" else "is a routes file of SUMO, but"
        raise PaveTwinError(
            f"'{path}' {what} holds no vehicle. Give routes (.rou.xml), as SUMO's duarouter or randomTrips.py write."
        )
    first = max(0.0, first) if math.isfinite(first) else 0.0
    return OwnDemand(first, max(first, last))


def _binary_kind(path: Path) -> str:
    """Kind of a file that is not XML; empty where it is unknown."""
    with path.open("rb") as file:
        head = file.read(4)
    if head == b"PAR1":
        return "a Parquet table (a recording of traffic is given as `traffic`)"
    return _KINDS["osm"] if suffix_of_content(path) == ".osm.pbf" else ""


def _seconds(time: str) -> float:
    """SUMO's times: seconds, or [days:]hours:minutes:seconds."""
    parts = reversed(time.split(":"))
    return sum(float(part) * worth for part, worth in zip(parts, (1, 60, 3600, 86400), strict=False))

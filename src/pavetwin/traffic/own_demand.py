"""A user's own demand: what SUMO route files hold, and when missions over it take off."""

import gzip
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.world.osm_file import suffix_of_content

WARM_UP_S: Final = 300.0
"""Missions take off so long after the first departure unless told otherwise, or with the last one where that is
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
"""What XML files are, by their root."""


@dataclass(frozen=True, slots=True)
class OwnDemand:
    """The departures of a user's demand, on SUMO's clock."""

    first_s: float
    last_s: float
    """Infinite where a flow has no stated end."""

    @property
    def begin_s(self) -> float:
        """When SUMO starts: with the first departure, in whole seconds."""
        return float(math.floor(self.first_s))

    @property
    def warm_up_s(self) -> float:
        """When missions take off unless told otherwise, in whole seconds after `begin_s`."""
        return float(math.floor(min(WARM_UP_S, self.last_s - self.begin_s)))


def own_demand(routes: Sequence[str | Path]) -> OwnDemand:
    """The demand of SUMO route files, plain or gzipped.

    Raises:
        PaveTwinError: a file is missing, no XML, or holds no vehicle; the message says which kind of file it is.
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
    """What a file is that is not XML; empty where it is not known."""
    with path.open("rb") as file:
        head = file.read(4)
    if head == b"PAR1":
        return "a Parquet table (a recording of traffic is given as `traffic`)"
    return _KINDS["osm"] if suffix_of_content(path) == ".osm.pbf" else ""


def _seconds(time: str) -> float:
    """SUMO's times: seconds, or [days:]hours:minutes:seconds."""
    parts = reversed(time.split(":"))
    return sum(float(part) * worth for part, worth in zip(parts, (1, 60, 3600, 86400), strict=False))

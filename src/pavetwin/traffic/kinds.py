"""The kinds of agents and their real sizes.

Lengths, widths and heights are in metres, without mirrors. Each size names its source. Their dynamics are SUMO's:
acceleration, deceleration and gaps are the defaults of the kind's SUMO vehicle class
(https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html) unless `behaviour` differs.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final
from xml.etree import ElementTree

import numpy as np

IMPATIENCE: Final = "0.5"
"""Drivers accept gaps that slow others down a little. With SUMO's default 0, half as many vehicles again end in
gridlock in dense traffic, over the towns tried."""

_SUMO_DEFAULTS: Final = "SUMO, Vehicle Type Parameter Defaults"
_RIDDEN: Final = f"{_SUMO_DEFAULTS}: motorcycle, with its rider"
_SU9: Final = "AASHTO Green Book, design vehicle SU-9: 9.2 × 2.4 × 3.4–4.1 m"
_BODY: Final = "Body: ours, inside Fruin's 0.46 × 0.61 m ellipse (1971)."
_NCD: Final = "Height: NCD-RisC 2016, European means."
_SPREAD: Final = "Spread: ours, 5 to 12 years. Speed: ours."


class AgentClass(StrEnum):
    """κ of the twin's dynamic agents."""

    VEHICLE = "vehicle"
    PEDESTRIAN = "pedestrian"


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of agent: its body, its share, and its motion in SUMO."""

    name: str
    agent_class: AgentClass
    sumo_class: str
    """SUMO's vClass: what the kind may drive on, and the defaults of its dynamics."""
    length_m: float
    width_m: float
    height_m: float
    share: float
    """Share of all agents of its class; the shares of a class sum to 1."""
    source: str
    """Source of the size."""
    height_sd_m: float = 0.0
    """Standard deviation of the height between individuals, cut at two of them."""
    behaviour: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """SUMO attributes that differ from the class's defaults."""
    model: str = ""
    """The kind whose 3-D model it is drawn with, scaled to its own size; empty for a model of its own."""

    @property
    def sumo_id(self) -> str:
        """The id of its SUMO type. A user's own types have no such prefix."""
        return f"pavetwin.{self.name}"

    def height_of_one(self, rng: np.random.Generator) -> float:
        """The height of one individual, in metres. Draws from `rng` only where the kind varies."""
        if not self.height_sd_m:
            return self.height_m
        return self.height_m + self.height_sd_m * float(np.clip(rng.standard_normal(), -2.0, 2.0))


def _vehicle(
    name: str,
    sumo_class: str,
    size_m: tuple[float, float, float],
    share: float,
    source: str,
    model: str = "",
    **behaviour: str,
) -> Kind:
    behaviour = {"impatience": IMPATIENCE, **behaviour}
    return Kind(
        name, AgentClass.VEHICLE, sumo_class, *size_m, share, source,
        behaviour=MappingProxyType(behaviour), model=model,
    )  # fmt: skip


def _pedestrian(
    name: str, size_m: tuple[float, float, float], sd_m: float, share: float, speed_mps: float, source: str
) -> Kind:
    return Kind(
        name, AgentClass.PEDESTRIAN, "pedestrian", *size_m, share, source, height_sd_m=sd_m,
        behaviour=MappingProxyType({"desiredMaxSpeed": f"{speed_mps:g}"}),
    )  # fmt: skip


# Shares by group: the UK's road traffic estimates for 2023 (Department for Transport, table TRA0101) have 75 % cars and
# taxis, 17 % light commercial, 5 % heavy goods, 0.6 % buses and 0.9 % motorcycles by distance driven on all roads. Town
# streets see fewer heavy goods and more buses and two-wheelers than motorways: 2, 2 and 3 % here. How the cars divide
# among the four bodies is our own choice.
_CALM = "normc(0.93,0.05,0.8,1.05)"
VEHICLES: Final[tuple[Kind, ...]] = (
    _vehicle(
        "hatchback", "passenger", (3.77, 1.66, 1.52), 0.16, "Hyundai Grand i10, the paper's: 3765 × 1660 × 1520 mm"
    ),
    _vehicle("compact", "passenger", (4.28, 1.79, 1.46), 0.23, "Volkswagen Golf 8: 4284 × 1789 × 1456 mm"),
    _vehicle("saloon", "passenger", (4.89, 1.84, 1.45), 0.17, "Toyota Camry XV70: 4885 × 1840 × 1445 mm"),
    _vehicle("suv", "passenger", (4.60, 1.86, 1.69), 0.20, "Toyota RAV4 XA50: 4600 × 1855 × 1685 mm"),
    _vehicle("van", "passenger", (4.90, 1.90, 1.99), 0.13, "Volkswagen Transporter 6.1: 4904 × 1904 × 1990 mm"),
    _vehicle("light_truck", "delivery", (6.50, 2.16, 2.86), 0.04, f"{_SUMO_DEFAULTS}: delivery"),
    _vehicle("heavy_truck", "truck", (9.20, 2.44, 3.75), 0.02, _SU9, speedFactor=_CALM),
    _vehicle("bus", "bus", (12.00, 2.50, 3.40), 0.02, f"{_SUMO_DEFAULTS}: bus", speedFactor=_CALM),
    _vehicle("motorcycle", "motorcycle", (2.20, 0.90, 1.50), 0.03, _RIDDEN, maxSpeed="30", accel="4"),
)
"""The default mix. A light truck moves as SUMO's delivery vehicle, a van like a passenger car."""

OTHER_VEHICLES: Final[tuple[Kind, ...]] = (
    _vehicle(
        "pickup", "passenger", (5.89, 2.03, 1.96), 0.0, "Ford F-150 SuperCrew (2021): 231.7 × 79.9 × 77.2 in", "suv"
    ),
    _vehicle("minibus", "bus", (6.99, 2.08, 2.63), 0.0, "Toyota Coaster: 6990 × 2080 × 2635 mm", "van"),
    _vehicle(
        "scooter", "moped", (1.83, 0.70, 1.50), 0.0,
        "Honda Activa 6G: 1833 × 697 mm; height with a rider as the motorcycle's", "motorcycle",
        maxSpeed="20", accel="3",
    ),
    _vehicle(
        "auto_rickshaw", "passenger", (2.64, 1.30, 1.70), 0.0, "Bajaj RE: 2635 × 1300 × 1704 mm", "hatchback",
        maxSpeed="16", accel="1.5",
    ),
)  # fmt: skip
"""Kinds that other mixes have (`pavetwin.traffic.mixes`); each is drawn with another kind's model, scaled. Their
top speed and acceleration are our assumptions."""

PEDESTRIANS: Final[tuple[Kind, ...]] = (
    _pedestrian("man", (0.28, 0.50, 1.77), 0.07, 0.42, 1.41, f"{_BODY} {_NCD} Speed: Weidmann 1993."),
    _pedestrian("woman", (0.26, 0.45, 1.64), 0.07, 0.42, 1.27, f"{_BODY} {_NCD} Speed: Weidmann 1993."),
    _pedestrian(
        "child", (0.20, 0.34, 1.27), 0.12, 0.10, 1.20, f"{_BODY} Height: WHO growth reference, 8 years. {_SPREAD}"
    ),
    _pedestrian(
        "senior", (0.27, 0.48, 1.66), 0.08, 0.06, 1.00, f"{_BODY} Speed: Highway Capacity Manual 2010, elderly."
    ),
)
"""Length is the depth of the body, width that of its shoulders."""

KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {kind.name: kind for kind in (*VEHICLES, *PEDESTRIANS, *OTHER_VEHICLES)}
)


def sumo_types(kinds: Iterable[Kind] = (*VEHICLES, *PEDESTRIANS)) -> str:
    """A SUMO additional file that defines the kinds as vTypes."""
    root = ElementTree.Element("additional")
    for kind in kinds:
        attributes = {
            "id": kind.sumo_id,
            "vClass": kind.sumo_class,
            "length": f"{kind.length_m:g}",
            "width": f"{kind.width_m:g}",
            "height": f"{kind.height_m:g}",
        }
        ElementTree.SubElement(root, "vType", attributes | dict(kind.behaviour))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


_OF_TYPE: Final = {kind.sumo_id: name for name, kind in KINDS.items()}


def kind_of_type(type_id: str, sumo_class: str) -> str:
    """The name of the kind that a SUMO type was made from; the vehicle class of a user's own type."""
    return _OF_TYPE.get(type_id) or sumo_class or "unknown"

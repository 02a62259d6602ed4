"""What each link of a traffic light lets through: read from the SUMO network when signals are to be shown."""

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import ParseError, iterparse

from pavetwin.errors import PaveTwinError


@dataclass(frozen=True, slots=True)
class SignalLink:
    """One letter of a traffic light's state."""

    controller: str
    index: int
    """Of the letter."""
    source: str
    """The edge that it lets out of."""
    target: str
    """The edge that it lets into: of pedestrians the crossing."""
    direction: str
    """SUMO's: s straight, l left, r right, t turn, L and R partly."""


def read_signal_links(network: Path) -> tuple[SignalLink, ...]:
    """All links of all traffic lights of a `.net.xml`, in the file's order.

    Raises:
        PaveTwinError: the file cannot be read as a SUMO network.
    """
    links = []
    try:
        for _, element in iterparse(network):
            if element.tag == "connection" and "tl" in element.attrib:
                links.append(
                    SignalLink(
                        controller=element.attrib["tl"],
                        index=int(element.attrib["linkIndex"]),
                        source=element.attrib["from"],
                        target=element.attrib["to"],
                        direction=element.get("dir", "s"),
                    )
                )
            if element.tag in ("edge", "connection", "junction"):
                element.clear()
    except (OSError, ParseError, KeyError, ValueError) as error:
        raise PaveTwinError(
            f"'{network}' is no complete SUMO network ({error}); build the world again with `pavetwin world build`."
        ) from error
    return tuple(links)

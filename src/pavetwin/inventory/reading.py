"""What a source of observations gave: a mission, or a folder of photographs."""

from collections.abc import Mapping
from dataclasses import dataclass

from pavetwin.inventory.observation import Observation
from pavetwin.world.georeference import GeoReference


@dataclass(frozen=True)
class Reading:
    """Observations in one metric frame."""

    observations: tuple[Observation, ...]
    frame: GeoReference | None
    """Of the places; None where no image says where it was taken."""
    images: int
    """How many were looked at."""
    remarks: tuple[str, ...] = ()
    """What is missing, a sentence each."""


def counted_remarks(found: Mapping[str, list[str]], wholes: int) -> tuple[str, ...]:
    """A sentence for each reason, with how many images it holds for and the first of them.

    Args:
        found: reason → names of images; a reason reads on from "3 photographs" or "1 photograph".
        wholes: how many images there are.
    """
    return tuple(
        f"{len(names)} of {wholes} photographs, such as '{names[0]}': {reason}." for reason, names in found.items()
    )

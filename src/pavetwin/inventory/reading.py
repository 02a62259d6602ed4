"""What a source of observations gave: a mission, or a folder of photographs."""

from collections.abc import Mapping
from dataclasses import dataclass

from pavetwin.errors import PaveTwinError
from pavetwin.inventory.observation import Observation
from pavetwin.sensing.fitted_sensor import EntryModel
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
    detector: str | None = None
    """SHA-256 of the model file that looked at the images; None where that is not known."""
    entry_model: EntryModel | None = None
    """Tells how likely entries show a defect; None where no sensor was fitted to the detector."""
    is_of_measuring: bool = False
    """Whether its sensor is known to measure sizes (`pavetwin.sensing.Sensor.measures_sizes`); asked where it reported
    nothing."""

    @property
    def is_measured(self) -> bool:
        """Whether sizes were measured of what was reported, or would have been had there been something."""
        return any(each.sizes for each in self.observations) if self.observations else self.is_of_measuring

    def confident(self, least: float) -> list[Observation]:
        """The observations of at least this confidence.

        Raises:
            PaveTwinError: it is not from 0 to 1.
        """
        if not 0 <= least <= 1:
            raise PaveTwinError(f"`confidence` {least:g}: it is from 0 to 1.")
        return [each for each in self.observations if each.confidence >= least]


def counted_remarks(found: Mapping[str, list[str]], wholes: int) -> tuple[str, ...]:
    """A sentence for each reason, with how many images it holds for and the first of them.

    Args:
        found: reason → names of images; a reason reads on from "3 photographs" or "1 photograph".
        wholes: how many images there are.
    """
    return tuple(
        f"{len(names)} of {wholes} photographs, such as '{names[0]}': {reason}." for reason, names in found.items()
    )

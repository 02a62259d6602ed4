"""Requests of a browser about maps, frames and flights by hand. The server handles these itself, so this module imports
little."""

import re
from enum import StrEnum
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, StringConstraints

from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError

KINDS: Final = (".osm", ".osm.pbf", ".net.xml")
"""Suffixes of the maps that are taken."""

LARGEST_KM2: Final = 10.0
"""Area of the rectangle around the streets of a map."""

LARGEST_BYTES: Final = 100_000_000
"""Largest size of a sent map."""


class FramePart(StrEnum):
    """Parts of a rendered capture, in order of cost; see `pavetwin.app.frame_source`."""

    PREVIEW = "preview"
    """The image alone, in as many pixels as are shown."""
    LABELLED = "labelled"
    """The image that `fly --save-frames` saves, with its labels."""
    SEARCHED = "searched"
    """Detections of the shipped detector."""


Deflection = Annotated[float, Field(ge=-1.0, le=1.0)]


class TownRequest(Settings):
    """Request to build a town from a map that the browser will send. It contains no path."""

    name: Annotated[str, StringConstraints(pattern=re.compile(r"^\w[\w-]{0,59}\Z"))]
    """Name of the town and of its folder."""
    kind: Literal[".osm", ".osm.pbf", ".net.xml"]
    bytes: Annotated[int, Field(ge=1)]
    left_hand: bool = False
    parking_rule: Annotated[str, StringConstraints(pattern=re.compile(r"^[a-z_]{1,40}\Z"))] = "europe"
    """Name of a shipped rule."""

    @classmethod
    def of(cls, values: Any) -> Self:
        """Raises:
        PaveTwinError: a value does not fit.
        """
        if not isinstance(values, dict):
            raise PaveTwinError("the page: a town is an object with `name`, `kind` and `bytes`.")
        request = cls.parse(values, where="the page")
        check_size(request.bytes)
        return request


def check_size(size: int) -> None:
    """Raises:
    PaveTwinError: a map is larger than the page takes.
    """
    if size > LARGEST_BYTES:
        raise PaveTwinError(
            f"The map has {size / 1e6:.0f} MB, and the page takes up to {LARGEST_BYTES // 10**6} MB; cut out a smaller "
            "area, or build it with `pavetwin world build`."
        )


class StickRequest(Settings):
    """Stick of a pilot, see `pavetwin.mission.by_hand.Stick`."""

    ahead: Deflection = 0.0
    left: Deflection = 0.0
    turn: Deflection = 0.0
    is_fast: bool = False
    lands: bool = False

    @classmethod
    def of(cls, values: Any) -> Self:
        """Raises:
        PaveTwinError: a value does not fit.
        """
        if not isinstance(values, dict):
            raise PaveTwinError("the page: a stick is an object with `ahead`, `left` and `turn`.")
        return cls.parse(values, where="the page")

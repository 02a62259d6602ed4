"""Tables of looks, and their columns."""

from dataclasses import dataclass
from typing import Final

import polars as pl

from pavetwin.sensing.fitted_sensor import FittedDetector

LOOK_COLUMNS: Final = {
    **dict.fromkeys(("kind", "severity"), pl.String),
    **dict.fromkeys(("width_px", "size_px", "pixel_mm", "visible_fraction", "inside_fraction"), pl.Float64),
    **dict.fromkeys(("off_centre", "blur_px", "sun_elevation_deg", "clouds"), pl.Float64),
}
"""Columns of `Look`, in its order."""

LOOK_SCHEMA: Final = {
    "capture": pl.Int64,
    "image_px": pl.Int64,
    "area_m2": pl.Float64,
    "defect": pl.Int64,
    "found": pl.Boolean,
    **LOOK_COLUMNS,
}
"""Columns of a table of looks: the capture's index; the longer side of the searched image, and its area on the ground;
the defect's id, whether it was found, and the look. A capture without a defect is one row, which has only `pixel_mm` of
a look."""

POSE_SCHEMA: Final = dict.fromkeys(("t_s", "x_m", "y_m", "yaw_rad"), pl.Float64)
"""Time and pose of a capture: further columns of a table of looks."""

CAPTURE: Final = "capture"
"""Column of a table of images: name of the capture among all sources; null if it is not known."""

GROUP: Final = "group"
"""Column of a table of looks: name of the defect among all sources."""


ALARM_SCHEMA: Final = {"image": pl.Int64, "kind": pl.String, "size_px": pl.Float64}
"""Columns of a table of false alarms: the row of its image, its class, and the root of its area."""


@dataclass(frozen=True)
class LookSource:
    """Looks, images and false alarms of one folder, all by one detector."""

    name: str
    detector: FittedDetector
    looks: pl.DataFrame
    """One row per look: `GROUP`, `found`, and `LOOK_COLUMNS`."""
    images: pl.DataFrame
    """One row per image: `area_m2` of its ground, `pixel_mm`, `CAPTURE`."""
    alarms: pl.DataFrame
    """One row per false alarm, see `ALARM_SCHEMA`."""

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
"""Those of `Look`, in its order."""

LOOK_SCHEMA: Final = {
    "capture": pl.Int64,
    "image_px": pl.Int64,
    "area_m2": pl.Float64,
    "defect": pl.Int64,
    "found": pl.Boolean,
    **LOOK_COLUMNS,
}
"""A table of looks: the capture's index; of the image that was looked at the longer side, and the ground in it; the
defect's id, whether it was found, and the look. A capture that sees no defect is a row too, of whose look only
`pixel_mm` is not null."""

POSE_SCHEMA: Final = dict.fromkeys(("t_s", "x_m", "y_m", "yaw_rad"), pl.Float64)
"""When and where a capture was taken: further columns of a table of looks, which those of earlier versions lack."""

CAPTURE: Final = "capture"
"""Column of a table of images: what names the capture among all sources; null where nothing tells whether another is
the same."""

GROUP: Final = "group"
"""Column of a table of looks: what names the defect among all sources."""


ALARM_SCHEMA: Final = {"image": pl.Int64, "kind": pl.String, "size_px": pl.Float64}
"""A table of false alarms: the row of its image, its class, and the root of its area."""


@dataclass(frozen=True)
class LookSource:
    """What one folder tells of a detector."""

    name: str
    detector: FittedDetector
    looks: pl.DataFrame
    """A row a look: `GROUP`, `found`, and `LOOK_COLUMNS`."""
    images: pl.DataFrame
    """A row an image: `area_m2` of its ground, `pixel_mm`, `CAPTURE`."""
    alarms: pl.DataFrame
    """A row a false alarm, see `ALARM_SCHEMA`."""

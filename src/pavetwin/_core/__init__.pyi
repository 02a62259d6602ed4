"""The kernels, in Rust. World frame: east-north-up, metres; yaw counter-clockwise from east, radians; time in seconds.

Every error that a user can fix is raised as `pavetwin.errors.PaveTwinError` with the kernel's own words. The stubs are
split by the kernel's modules; at run time everything is in `pavetwin._core` itself.
"""

from pavetwin._core._imaging import expose, texture_sample
from pavetwin._core._mission import (
    Arrived,
    Battery,
    BatteryLow,
    CaptureColumns,
    Captured,
    DisplacementPredictor,
    Flight,
    FlightSettings,
    Occluded,
    Paused,
    RecordingEnds,
    TrackColumns,
)
from pavetwin._core._navigation import Limits, NavMesh
from pavetwin._core._raster import (
    raster_covered,
    raster_looked_up,
    raster_painted,
    raster_tracks,
    raster_weathered,
)
from pavetwin._core._relief import (
    relief_blocks,
    relief_largest_part,
    relief_mesh,
    relief_noise,
    relief_outline,
    relief_pebbles,
    relief_region,
    relief_trace,
    relief_widths,
)
from pavetwin._core._sensing import DefectShares, Ground, LookColumns, NadirCamera, PoseColumns, Trace, Viewpoint

__all__ = [
    "MODES",
    "Arrived",
    "Battery",
    "BatteryLow",
    "CaptureColumns",
    "Captured",
    "DefectShares",
    "DisplacementPredictor",
    "Flight",
    "FlightSettings",
    "Ground",
    "Limits",
    "LookColumns",
    "NadirCamera",
    "NavMesh",
    "Occluded",
    "Paused",
    "PoseColumns",
    "RecordingEnds",
    "Trace",
    "TrackColumns",
    "Viewpoint",
    "__version__",
    "expose",
    "raster_covered",
    "raster_looked_up",
    "raster_painted",
    "raster_tracks",
    "raster_weathered",
    "relief_blocks",
    "relief_largest_part",
    "relief_mesh",
    "relief_noise",
    "relief_outline",
    "relief_pebbles",
    "relief_region",
    "relief_trace",
    "relief_widths",
    "texture_sample",
]

__version__: str

MODES: tuple[str, ...]
"""Names of the modes in `TrackColumns`, by number."""

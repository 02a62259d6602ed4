"""What the camera of an option shows of the ground, and which defects it cannot show."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any, Final

from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.mission import LEAST_PX
from pavetwin.config.settings import ALIASES
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.mission.environment import inspect_speed_mps, shutter_s
from pavetwin.reports.words import listed
from pavetwin.sensing import sensor_class
from pavetwin.sensing.resolution import is_thin, least_px_of
from pavetwin.uav import camera_of
from pavetwin.uav.aircraft import camera_name

_WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "single_crack": ("cracks", "thinner"),
    "crocodile_crack": ("crocodile cracks", "narrower"),
    "pothole": ("potholes", "narrower"),
}
_BLUR_COUNTS: Final = 1.1
"""Where blur widens the least crack by less than a tenth, its direction is not worth saying."""


@dataclass(frozen=True)
class GroundView:
    """From one altitude, with one camera, at the speed of inspection."""

    altitude_m: float
    camera: str
    """As `camera.model` names it."""
    pixel_m: float
    """What a pixel covers on the ground."""
    blur_px: float
    """Motion blur at the speed of inspection."""
    unseen_m: Mapping[str, float]
    """By class the extent below which a defect covers fewer than `sensing.least_px` pixels, blur included: the width of
    a crack across the flight, else the shorter side."""
    unseen_along_m: Mapping[str, float]
    """The same of thin classes along the flight, which blur does not widen."""
    is_counted: bool
    """Whether the missions counted this. Else their sensor finds a defect whatever its size in pixels."""

    @property
    def sentence(self) -> str:
        """`From 10 m with the camera paper a pixel covers 12 mm: cracks across the flight thinner than 26 mm …`."""
        small = listed([self._small(kind) for kind in self.unseen_m])
        begin = f"From {self.altitude_m:g} m with the camera {self.camera} a pixel covers {_length(self.pixel_m)}"
        if self.is_counted:
            return f"{begin}: {small} are not seen from here."
        return f"{begin}. These missions do not count pixels: a real detector may miss {small} from here."

    def _small(self, kind: str) -> str:
        """`cracks thinner than 292 mm`; where blur counts, `cracks across the flight thinner than … (along it …)`."""
        name, thinner = _WORDS.get(kind, (kind, "narrower"))
        across_m = self.unseen_m[kind]
        along_m = self.unseen_along_m.get(kind, across_m)
        if across_m < _BLUR_COUNTS * along_m:
            return f"{name} {thinner} than {_length(across_m)}"
        return f"{name} across the flight {thinner} than {_length(across_m)} (along it {_length(along_m)})"


def ground_view(option: Mapping[str, Any], design: Mapping[str, Any]) -> GroundView:
    """The view of one option of a study.

    Args:
        option: its altitude and preset, its sensor and what else is swept, by the table's columns.
        design: plain values of `design.yaml`.

    Raises:
        PaveTwinError: the preset, a setting or the camera is not known here any more.
    """
    settings = _settings(option, design)
    sensing, camera = settings.sensing, camera_of(settings)
    pixel_m = camera.ground_resolution_m(settings.altitude_m)
    blur_px = inspect_speed_mps(settings) * shutter_s(settings) / pixel_m
    is_counted = sensing.least_px is not None and sensor_class(sensing.sensor).judges_size
    counting = sensing if sensing.least_px is not None else sensing.model_copy(update={"least_px": dict(LEAST_PX)})
    kinds = sorted(
        (set(counting.least_px or ()) & set(DEFECT_CLASSES.names())), key=lambda kind: (not is_thin(kind), kind)
    )
    return GroundView(
        altitude_m=settings.altitude_m,
        camera=camera_name(settings),
        pixel_m=pixel_m,
        blur_px=blur_px,
        unseen_m={kind: least_px_of(counting, kind) * pixel_m * hypot(1.0, blur_px) for kind in kinds},
        unseen_along_m={kind: least_px_of(counting, kind) * pixel_m for kind in kinds if is_thin(kind)},
        is_counted=is_counted,
    )


def _settings(option: Mapping[str, Any], design: Mapping[str, Any]) -> MissionSettings:
    """How its missions were flown. Where a swept setting is averaged over, the first of its values counts."""
    values = dict(design.get("set") or {})
    for key, levels in (design.get("sweep") or {}).items():
        column = key if key in option else f"{key}_set"
        if column not in option or option[column] is not None:  # else its policy or sensor lacks the setting
            values[key] = next((level for level in levels if str(level) == str(option.get(column))), levels[0])
    overrides = [f"{ALIASES.get(key, key)}={value}" for key, value in values.items()]
    return load_settings(
        str(option["preset"]),
        overrides,
        altitude_m=option["altitude_m"],
        sensing={"sensor": option.get("sensor", "recall")},
        plugins=tuple(design.get("plugins") or ()),
    )


def _length(metres: float) -> str:
    """`1.6 mm`, `292 mm`, `2.3 m`."""
    millimetres = 1000 * metres
    if millimetres < 10:
        return f"{millimetres:.1f} mm"
    return f"{millimetres:.0f} mm" if millimetres < 1000 else f"{metres:.1f} m"

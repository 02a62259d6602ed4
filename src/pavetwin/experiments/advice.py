"""Advice of a study: a recommendation for each combination of its assumptions, and the view of its camera."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any, Final

import polars as pl

from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.mission import LEAST_PX
from pavetwin.config.settings import ALIASES
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import ENVIRONMENT
from pavetwin.experiments.metrics import INDEX_ERROR, REPLICATE, has_detected
from pavetwin.experiments.statistics import MissionLimits, Objective, Recommendation, recommend
from pavetwin.experiments.statistics.cells import levels_of
from pavetwin.experiments.statistics.recommend import UNMEASURED
from pavetwin.experiments.tours import by_mission
from pavetwin.experiments.words import setting
from pavetwin.mission.environment import inspect_speed_mps, shutter_s
from pavetwin.reports.words import listed, opened
from pavetwin.sensing import sensor_class
from pavetwin.sensing.resolution import is_thin, least_px_of
from pavetwin.uav import camera_of
from pavetwin.uav.aircraft import camera_name

_WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "single_crack": ("cracks", "thinner"),
    "crocodile_crack": ("crocodile cracks", "narrower"),
    "pothole": ("potholes", "narrower"),
}
_BLUR_COUNTS: Final = 1.1  # Blur that widens the least crack by less than this factor is not described by direction


@dataclass(frozen=True)
class GroundView:
    """From one altitude, with one camera, at the speed of inspection."""

    altitude_m: float
    camera: str
    """Name in `camera.model`."""
    pixel_m: float
    """Ground covered by a pixel."""
    blur_px: float
    """Motion blur at the speed of inspection."""
    unseen_m: Mapping[str, float]
    """Extent, keyed by class, below which a defect covers fewer than `sensing.least_px` pixels, blur included: the
    width of a crack across the flight, else the shorter side."""
    unseen_along_m: Mapping[str, float]
    """Limit of thin classes along the flight, which blur does not widen."""
    is_counted: bool
    """True if the sensor of the missions judges the size in pixels."""

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
        PaveTwinError: the preset, a setting or the camera is no longer known here.
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
    """Settings of its missions. The first value of a swept setting stands for an average over it."""
    values = dict(design.get("set") or {})
    for key, levels in (design.get("sweep") or {}).items():
        column = key if key in option else f"{key}_set"
        if column not in option or option[column] is not None:  # else its policy or sensor does not have the setting
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


ASSUMED = ("sensor", "preset")
"""Factors that are assumptions of a study, not options to choose from."""


@dataclass(frozen=True)
class Advice:
    assumption: str
    """The sensor and the preset as a sentence; empty where the study has one of each."""
    recommendation: Recommendation
    view: GroundView | None = None
    """From the option that is recommended or nearest; None where there is none, or the design is not known."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """The recommendation in up to three sentences, and what the camera resolves from there."""
        return (*self.recommendation.sentences, *([self.view.sentence] if self.view else []))


def advise(
    table: pl.DataFrame,
    limits: MissionLimits,
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
    design: Mapping[str, Any] | None = None,
) -> list[Advice]:
    """A recommendation among altitudes, policies and swept settings, over the worlds and traffic of the table.

    Args:
        table: of segment missions; where these are parts of tours, whole missions are judged.
        design: plain values of `design.yaml`, for what the camera shows.

    Raises:
        PaveTwinError: the objective needs a least coverage, since an option that finds nothing could win, and none is
            found; or it asks for the most accurate index, and no mission has one by what was detected.
    """
    table = by_mission(table)
    if INDEX_ERROR in objective.judged and not has_detected(table):
        raise PaveTwinError(f"`objective` {objective}: {UNMEASURED}; fly a study with the sensor 'detector'.")
    varied = table.columns[table.columns.index("altitude_m") : table.columns.index(REPLICATE)]
    given = {name for name in varied if ALIASES.get(name, name) in ENVIRONMENT}
    chosen_by = {name for name in varied if name not in {*ASSUMED, *given} and len(levels_of(table, name)) > 1}
    by = [name for name in varied if name in chosen_by | {"altitude_m", "policy"}]
    assumed = [name for name in ASSUMED if len(levels_of(table, name)) > 1]
    advice = []
    for part in table.partition_by(assumed, maintain_order=True) if assumed else [table]:
        made = recommend(part, limits, by, objective=objective, seed=seed)
        first, option = part.row(0, named=True), made.best or made.nearest
        view = ground_view({**first, **option}, design) if option and design else None
        advice.append(Advice(opened(setting(first, assumed)) if assumed else "", made, view))
    return advice

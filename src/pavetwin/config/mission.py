"""Everything that decides how a mission is flown, and the presets `default` and `paper`."""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from pavetwin.config.altitude import Altitude
from pavetwin.config.base import NameOrFile, PluginFiles, Settings, overlay, with_overrides
from pavetwin.config.conditions import Conditions
from pavetwin.config.numbers import NonNegative, Positive, Share
from pavetwin.config.options import Options
from pavetwin.config.parking import ParkingSettings
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.plugins import load_plugins


class UavSettings(Settings):
    """The airframe's limits: Unity's NavMesh agent of the paper, and what it leaves open."""

    radius_m: Positive = 0.5
    inspect_speed_mps: Positive | None = None
    """Null: 5 m/s, or slower where the camera takes too few pictures to see all that it passes. A speed that is given
    is flown."""
    transit_speed_mps: Positive = 10.0
    acceleration_mps2: Positive = 8.0
    yaw_rate_deg_s: Positive = 45.0
    stopping_distance_m: NonNegative = 1.0
    climb_speed_mps: Positive = 3.0
    """Between the ground and the altitude, as far as the aircraft climbs and descends so fast."""
    base: Literal["street", "roadside"] = "roadside"
    """Where it takes off unless a mission says so: in the middle of the world's streets, or beside the carriageway
    there."""


class CameraSettings(Settings):
    """Which camera looks straight down, how often it captures, and its inspection window."""

    model: NameOrFile | None = None
    """A name of the camera database, or a path to a YAML file of the same form; null for the aircraft's own."""
    capture_interval_s: Positive = 0.6
    """Between captures, as far as the camera takes pictures so fast (its `shortest_interval_s`)."""
    exposure_s: Positive = 0.001
    """Shutter time of the captures that a mission judges without rendering them; never shorter than the camera's
    shortest. The motion meanwhile blurs the image."""
    window_rows: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of the image rows (along the track) in which a defect counts as centred."""
    window_columns: Annotated[float, Field(gt=0, le=1)] | None = 1.0
    """Share of the image columns (across the track); null when `window_across_per_altitude` is given."""
    window_across_per_altitude: Positive | None = None
    """Width of the window across the track, in metres a metre of altitude (the paper: 0.6)."""

    @model_validator(mode="after")
    def _one_width(self) -> Self:
        if (self.window_columns is None) == (self.window_across_per_altitude is None):
            raise ValueError("give exactly one of window_columns and window_across_per_altitude (the other null)")
        return self


class VisibilitySettings(Settings):
    threshold: Share = 0.7
    """τ_o: below it a policy is asked."""
    interval_s: Positive = 0.3
    cell_m: Annotated[float, Field(ge=0.05, le=2)] = 0.25
    inspected_share: Annotated[float, Field(gt=0, le=1)] = 0.95


class PatternSettings(Settings):
    kind: str = "boustrophedon"
    """A name of the registry in pavetwin.navigation.patterns: boustrophedon or out_and_back."""
    side_overlap: Annotated[float, Field(ge=0, lt=0.9)] = 0.2
    """Share of the window's width that neighbouring passes of the boustrophedon share."""


class PolicySettings(Settings):
    """What the built-in policies read, and the options of a user's own."""

    wait_s: Positive = 2.0
    max_wait_s: Positive = 300.0
    max_displacement_m: Positive = 3.0
    note_spacing_m: NonNegative = 1.5
    note_interval_s: NonNegative = 2.0
    revisit_stay_s: Positive = 5.0
    options: Options = Field(default_factory=dict)
    """Of a user's own policy, which says what options it has (`Policy.default_options`). A file that one names is
    hashed into the mission."""


LEAST_PX: Final[Mapping[str, float]] = {"single_crack": 2.0, "crocodile_crack": 16.0, "pothole": 8.0}
"""Assumptions until a sensor is fitted to a detector (docs/explanation/definitions.md, "Detection and resolution")."""


class SensingSettings(Settings):
    sensor: NameOrFile = "recall"
    recall: Share = 0.840
    """Of the paper's YOLOv8n."""
    min_visible_fraction: Share = 0.35
    attempts: Literal["every_capture", "first_capture"] = "every_capture"
    """`first_capture`: a defect gets one attempt, and one more for each revisit."""
    look_correlation: Share = 0.8
    """Of `recall`: correlation between looks at one defect. 0: every look is a new draw; 1: a defect that one look
    missed is missed by all that show as much."""
    least_px: Mapping[str, NonNegative] | None = Field(default_factory=lambda: dict(LEAST_PX), validate_default=True)
    """Of `recall`, by class: what covers fewer pixels across is not seen: a crack across its width, any other defect
    across its shorter side. Classes that are not named keep their defaults; null: size does not matter."""
    full_recall_ratio: Annotated[float, Field(gt=1, le=100)] = 3.0
    """Of `recall`: at so many times `least_px` a defect is found with the probability `recall`; below, less often."""
    options: Options = Field(default_factory=dict)
    """Of a user's own sensor, which says what options it has (`Sensor.default_options`). A file that one names, such as
    a model, is hashed into the mission."""

    @field_validator("least_px", mode="after")
    @classmethod
    def _least_of_every_class(cls, given: Mapping[str, float] | None) -> Mapping[str, float] | None:
        return None if given is None else {**LEAST_PX, **given}


class EnergySettings(Settings):
    MOVED: ClassVar[Mapping[str, str]] = {
        "wind_mps": "conditions.wind_mps",
        "wind_from_deg": "conditions.wind_from_deg",
        "hover_endurance_s": "aircraft",
        "mass_kg": "aircraft",
    }

    model: str = "rotor"
    """A name of the registry in pavetwin.uav.energy: rotor or linear."""
    endurance_s: Positive = 1800.0
    """Of the linear model, which reads none of the capacities below."""
    capacity_wh: Positive | None = None
    """Nominal energy of the batteries flown with at once; null for the aircraft's own."""
    usable: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Share of the nominal energy that flights may use: below it the voltage sags and the maker's own warnings begin.
    Everything that is said of a battery, the reserve too, is a share of this part."""
    health: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of its nominal energy that an aged battery still holds."""
    payload_kg: NonNegative = 0.0
    """Carried on top of the aircraft and its own camera."""
    climb_efficiency: Annotated[float, Field(gt=0, le=1)] = 0.7
    """Share of the battery's power that a climb turns into potential energy."""
    reserve: Annotated[float, Field(ge=0, lt=0.9)] = 0.15
    """Share of the usable energy that must be left after landing: for a landing that is put off, or wind that rises."""
    swap_s: NonNegative = 120.0
    """From landing with an empty battery to take-off with a full one."""


LEAST_AREA_M: Final = 100.0
"""Traffic that enters an area needs a block's length to queue at signals."""


class MissionSettings(Settings):
    """One mission, complete."""

    altitude_m: Altitude = 10.0
    time_step_s: Annotated[float, Field(gt=0, le=0.1)] = 0.05
    aircraft: NameOrFile | None = "mavic3e"
    """A name of the aircraft profiles, or a path to a YAML file of the same form. It gives mass, power, batteries, top
    speed, wind limit and camera; null for the paper's UAV, which has none of these and takes a camera by name."""
    uav: UavSettings = UavSettings()
    camera: CameraSettings = CameraSettings()
    visibility: VisibilitySettings = VisibilitySettings()
    pattern: PatternSettings = PatternSettings()
    policy: PolicySettings = PolicySettings()
    sensing: SensingSettings = SensingSettings()
    energy: EnergySettings = EnergySettings()
    conditions: Conditions = Conditions()
    parking: ParkingSettings = ParkingSettings()
    traffic_area_m: Annotated[float, Field(ge=LEAST_AREA_M)] | None = None
    """Traffic is recorded on the streets within this distance of the targets; null: on those of the whole town."""
    plugins: PluginFiles = ()
    """Files of the user's own that register what a setting names; read when settings are made."""

    @model_validator(mode="after")
    def _with_plugins(self) -> Self:
        load_plugins(self.plugins)
        return self

    @model_validator(mode="after")
    def _whole_steps(self) -> Self:
        for name, interval in (
            ("camera.capture_interval_s", self.camera.capture_interval_s),
            ("visibility.interval_s", self.visibility.interval_s),
        ):
            steps = interval / self.time_step_s
            if steps < 0.999 or abs(steps - round(steps)) > 1e-6:
                raise ValueError(f"{name} ({interval} s) must be a whole number of time steps ({self.time_step_s} s)")
        return self


def preset_names() -> list[str]:
    """The presets that ship with the package."""
    return sorted(
        entry.name.removesuffix(".yaml")
        for entry in (files("pavetwin.config") / "presets").iterdir()
        if entry.name.endswith(".yaml")
    )


def load_settings(preset: str = "default", overrides: Iterable[str] = (), **given: Any) -> MissionSettings:
    """A preset, overridden by keyword values (nested mappings) and then by `key=value` texts.

    Raises:
        PaveTwinError: the preset, a key or a value is not known or does not fit.
    """
    names = preset_names()
    if preset not in names:
        raise PaveTwinError(no_such("preset", preset, names, key="`preset`"))
    values = overlay(_values(preset), given)
    return MissionSettings.parse(with_overrides(values, overrides), where=f"settings (preset '{preset}')")


@cache
def _values(preset: str) -> Mapping[str, Any]:
    """What a preset's file says: read once, since a study asks hundreds of times. Nobody may change it."""
    text = (files("pavetwin.config") / "presets" / f"{preset}.yaml").read_text(encoding="utf-8")
    return parse_yaml(text, where=f"preset '{preset}'") or {}

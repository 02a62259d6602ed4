"""Everything that decides how a mission is flown, and the presets `default` and `paper`."""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from pavetwin.config.conditions import Conditions
from pavetwin.config.named import names_in
from pavetwin.config.options import Options
from pavetwin.config.settings import (
    NameOrFile,
    NonNegative,
    PluginFiles,
    Positive,
    Settings,
    Share,
    overlay,
    with_overrides,
)
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.plugins import load_plugins

VERTICAL_CLEARANCE_M: Final = 1.0
"""Kept above and below the UAV: whatever reaches into altitude ± this is an obstacle."""

TALLEST_VEHICLE_M: Final = 4.0
"""Limit of Council Directive 96/53/EC; recorded traffic does not give way to a UAV."""

LOWEST_M: Final = TALLEST_VEHICLE_M + VERTICAL_CLEARANCE_M

CEILING_M: Final = 120.0
"""Ceiling of the open category in the EU, (EU) 2019/947; 14 CFR 107.51 has 400 ft, 122 m."""


def checked_altitude(altitude_m: float) -> float:
    """The altitude, if the UAV may fly there.

    Raises:
        ValueError: it is too low, too high, or not a number; the message does not name the value.
    """
    if not altitude_m >= LOWEST_M:
        raise ValueError(
            f"the UAV flies at {LOWEST_M:g} m or higher, {VERTICAL_CLEARANCE_M:g} m clear of vehicles of up to "
            f"{TALLEST_VEHICLE_M:g} m; choose a higher altitude"
        )
    if altitude_m > CEILING_M:
        raise ValueError(
            f"the UAV flies at {CEILING_M:g} m or lower, the legal ceiling in the EU and the US; choose a lower "
            "altitude"
        )
    return altitude_m


def check_altitude(altitude_m: float) -> None:
    """Check that the UAV may fly at an altitude.

    Raises:
        PaveTwinError: it may not; the message names the parameter.
    """
    try:
        checked_altitude(altitude_m)
    except ValueError as error:
        raise PaveTwinError(f"`altitude_m` {altitude_m:g}: {error}.") from error


Altitude = Annotated[float, AfterValidator(checked_altitude)]
"""Altitude in settings, in metres."""


class ParkingSettings(Settings):
    """Parked vehicles of a mission."""

    enabled: bool = True
    """Vehicles stand in the parking places."""
    occupancy: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the places that are taken; null: the daily curve for type of street, day of the week and time."""


class UavSettings(Settings):
    """The airframe's limits: Unity's NavMesh agent of the paper, and what it leaves open."""

    radius_m: Positive = 0.5
    """Radius of the airframe; the NavMesh keeps this distance from obstacles."""
    inspect_speed_mps: Positive | None = None
    """Inspection speed. Null: 5 m/s, or slower where the camera's interval would leave gaps; a number is flown as
    given."""
    transit_speed_mps: Positive = 10.0
    """Speed between segments, to revisits and home."""
    acceleration_mps2: Positive = 8.0
    """Acceleration, braking and centripetal acceleration."""
    yaw_rate_deg_s: Positive = 45.0
    """Angular speed about the vertical."""
    stopping_distance_m: NonNegative = 1.0
    """Distance from a goal that counts as arrived."""
    climb_speed_mps: Positive = 3.0
    """Vertical speed, up to the limits of the aircraft."""
    base: Literal["street", "roadside"] = "roadside"
    """Default take-off place: next to the carriageway, or in the middle of the streets."""


class CameraSettings(Settings):
    """Which camera looks straight down, how often it captures, and its inspection window."""

    model: NameOrFile | None = None
    """Registered camera, or a YAML file of cameras; null: the aircraft's own."""
    capture_interval_s: Positive = 0.6
    """Interval between captures, at least the camera's `shortest_interval_s`."""
    exposure_s: Positive = 0.001
    """Exposure of captures judged without rendering, at least the camera's shortest; motion during it blurs the
    image."""
    window_rows: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of the image rows (along the track) in which a defect counts as centred."""
    window_columns: Annotated[float, Field(gt=0, le=1)] | None = 1.0
    """Share of the image columns (across the track); null with `window_across_per_altitude`."""
    window_across_per_altitude: Positive | None = None
    """Width of the window across the track per metre of altitude."""

    @model_validator(mode="after")
    def _one_width(self) -> Self:
        if (self.window_columns is None) == (self.window_across_per_altitude is None):
            raise ValueError("give exactly one of window_columns and window_across_per_altitude (the other null)")
        return self


class VisibilitySettings(Settings):
    threshold: Share = 0.7
    """τ_o: below it the policy decides."""
    interval_s: Positive = 0.3
    """Interval between evaluations of the visibility."""
    cell_m: Annotated[float, Field(ge=0.05, le=2)] = 0.25
    """Side of the cells of a segment's surface."""
    inspected_share: Annotated[float, Field(gt=0, le=1)] = 0.95
    """Share of the visible cells that makes a segment inspected."""


class PatternSettings(Settings):
    kind: str = "boustrophedon"
    """Inspection pattern: `boustrophedon` or `out_and_back`."""
    side_overlap: Annotated[float, Field(ge=0, lt=0.9)] = 0.2
    """Share of the window's width that neighbouring passes of `boustrophedon` share."""


class PolicySettings(Settings):
    """Settings of the shipped policies, and options of a user's own."""

    wait_s: Positive = 2.0
    """`hover`: wait between two evaluations."""
    max_wait_s: Positive = 300.0
    """`hover`: longest wait in one occlusion episode."""
    max_displacement_m: Positive = 3.0
    """`micro`: longest displacement."""
    note_spacing_m: NonNegative = 1.5
    """`skip`: minimum distance between two notes."""
    note_interval_s: NonNegative = 2.0
    """`skip`: minimum time between two notes."""
    revisit_stay_s: Positive = 5.0
    """`skip`: stay at a revisited place."""
    options: Options = Field(default_factory=dict)
    """Options of a custom policy (`Policy.default_options`); files named here are hashed into the mission."""


LEAST_PX: Final[Mapping[str, float]] = {"single_crack": 2.0, "crocodile_crack": 16.0, "pothole": 8.0}
"""Assumptions until a sensor is fitted to a detector (docs/explanation/definitions.md, "Detection and resolution")."""


class SensingSettings(Settings):
    sensor: NameOrFile = "recall"
    """`recall`, `ideal`, `calibrated`, `detector`, or a custom sensor."""
    recall: Share = 0.840
    """`recall`: probability of finding a large, sharp defect; 0.84 is the paper's YOLOv8n."""
    min_visible_fraction: Share = 0.35
    """Share of a defect that must be visible in a capture."""
    attempts: Literal["every_capture", "first_capture"] = "every_capture"
    """`every_capture`: each capture is an attempt. `first_capture`: one attempt per defect and one per revisit."""
    look_correlation: Share = 0.8
    """`recall`: correlation between attempts at one defect. 0: independent; 1: all or none."""
    least_px: Mapping[str, NonNegative] | None = Field(default_factory=lambda: dict(LEAST_PX), validate_default=True)
    """`recall`, by class: minimum size in pixels, across a crack or the shorter side of any other defect. Null: no
    limit."""
    full_recall_ratio: Annotated[float, Field(gt=1, le=100)] = 3.0
    """`recall`: multiple of `least_px` from which the full recall applies."""
    options: Options = Field(default_factory=dict)
    """Options of `detector` or of a custom sensor (`Sensor.default_options`); files named here are hashed into the
    mission."""

    @field_validator("least_px", mode="after")
    @classmethod
    def _least_of_every_class(cls, given: Mapping[str, float] | None) -> Mapping[str, float] | None:
        return None if given is None else {**LEAST_PX, **given}


class EnergySettings(Settings):
    """The energy model and the batteries."""

    model: str = "rotor"
    """Energy model: `rotor` or `linear`."""
    endurance_s: Positive = 1800.0
    """`linear`: time from full to empty; the capacities below are unused."""
    capacity_wh: Positive | None = None
    """Nominal energy of the batteries flown with at once; null: the aircraft's own."""
    usable: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Usable share of the nominal energy. All shares of a battery refer to this part."""
    health: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the nominal energy that an aged battery still holds."""
    payload_kg: NonNegative = 0.0
    """Payload on top of the aircraft and its own camera."""
    climb_efficiency: Annotated[float, Field(gt=0, le=1)] = 0.7
    """Share of the battery's power that a climb turns into potential energy."""
    reserve: Annotated[float, Field(ge=0, lt=0.9)] = 0.15
    """Share of the usable energy that must be left after landing."""
    swap_s: NonNegative = 120.0
    """Time from landing with an empty battery to take-off with a full one."""


LEAST_AREA_M: Final = 100.0
"""Traffic that enters an area needs a block's length to queue at signals."""


class MissionSettings(Settings):
    """One mission, complete."""

    altitude_m: Altitude = 10.0
    """Altitude above ground, 5 to 120 m."""
    time_step_s: Annotated[float, Field(gt=0, le=0.1)] = 0.05
    """Time step, at most 0.1 s."""
    aircraft: NameOrFile | None = "mavic3e"
    """Aircraft profile, or a YAML file of profiles: mass, power, batteries, top speed, rated wind, camera. Null: the
    paper's UAV."""
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
    """Record traffic only within this distance of the targets (at least 100 m); null: in the whole town."""
    plugins: PluginFiles = ()
    """Python files that register what a setting names."""

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
    return names_in("pavetwin.config", "presets")


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
    """Content of a preset's file, cached and read-only: a study asks for it hundreds of times."""
    text = (files("pavetwin.config") / "presets" / f"{preset}.yaml").read_text(encoding="utf-8")
    return parse_yaml(text, where=f"preset '{preset}'") or {}

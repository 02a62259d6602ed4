"""Aircraft profiles: mass, payload, batteries, limits and camera of a kind of aircraft.

A profile holds the maker's figures only. `pavetwin.uav.energy` computes power over airspeed from them, and
`pavetwin.uav.wind` tilt and motion in gusts.
"""

from collections.abc import Mapping
from math import pi, radians, tan
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from pavetwin.config.mission import MissionSettings
from pavetwin.config.settings import NonNegative, Positive, Settings
from pavetwin.errors import PaveTwinError
from pavetwin.registry import Registry
from pavetwin.uav.cameras import CAMERAS, Camera, find_camera
from pavetwin.uav.entries import find_entry, mappings_in, own_file

Angle = Annotated[float, Field(ge=-180, le=180)]

GRAVITY_MPS2: Final = 9.81

AIR_KG_M3: Final = 1.225
"""Density of the air at sea level and 15 °C (standard atmosphere)."""

FUSELAGE_DRAG_RATIO: Final = 0.6
ROTOR_SOLIDITY: Final = 0.05
"""The product of these two is the drag area over the disc area of a profile without a stated tilt: table I of Zeng, Xu
and Zhang, IEEE Trans. Wireless Commun. 18(4), 2019."""


class Gimbal(Settings):
    """The gimbal, which holds the camera straight down."""

    axes: Literal[0, 2, 3]
    """Stabilised axes: 3 (pitch, roll and yaw), 2 (pitch and roll), or 0 for a camera fixed to the airframe."""
    tilt_deg: tuple[Angle, Angle] = (-90.0, 0.0)
    """Controllable pitch, the lowest and the highest: −90 is straight down, 0 level."""
    holds_deg: Annotated[float, Field(ge=0, le=90)] = 0.0
    """Tilt of the airframe up to which the camera stays straight down."""

    @model_validator(mode="after")
    def _looks_down(self) -> Self:
        low, high = self.tilt_deg
        if not low <= -90 <= high:
            raise ValueError("tilt_deg: the camera must reach straight down, -90")
        if self.axes == 0 and self.holds_deg > 0:
            raise ValueError("holds_deg: a camera without stabilised axes holds nothing; give 0")
        return self


class AircraftProfile(Settings):
    """One kind of multicopter with its camera, in the maker's figures."""

    title: str
    camera: str
    """A name of the camera database, or a YAML file, relative to the file of the profile."""
    mass_kg: Positive
    """With its batteries, as the maker measured the flight time."""
    payload_kg: NonNegative = 0.0
    """Carried on top of that: a camera that comes off."""
    rotors: Annotated[int, Field(ge=3, le=16)]
    rotor_diameter_m: Positive
    battery_wh: Positive
    """Nominal energy of one battery."""
    batteries: Annotated[int, Field(ge=1, le=12)] = 1
    """Flown with at once; they are changed together."""
    flight_time_min: Positive
    """The maker's longest flight in still air, from full to empty."""
    flight_speed_mps: Positive | None = None
    """Airspeed of that flight, where the maker states one; otherwise it is the one that needs the least power."""
    hover_time_min: Positive | None = None
    """The maker's longest hover in still air, where one is stated."""
    top_speed_mps: Positive
    """Highest airspeed."""
    tilt_deg: Annotated[float, Field(gt=0, lt=80)] | None = None
    """Tilt of the airframe at the highest airspeed, if the maker states one: the drag follows from it."""
    climb_mps: Positive
    descent_mps: Positive
    wind_limit_mps: Positive
    """Rated wind: the maker's highest wind speed."""
    gimbal: Gimbal
    source: Annotated[str, Field(min_length=1)]
    """Where the figures are from."""
    sources: Mapping[str, str] = Field(default_factory=dict)
    """Where single figures are from, by their key, as far as not from `source`."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.hover_time_min is not None and self.hover_time_min > self.flight_time_min:
            raise ValueError("hover_time_min: hovering cannot last longer than flight_time_min")
        if self.hover_time_min is not None and self.hover_time_min < self.flight_time_min / 2:
            raise ValueError("hover_time_min: less than half of flight_time_min, which no rotor's power explains")
        if self.wind_limit_mps >= self.top_speed_mps:
            raise ValueError("wind_limit_mps must be below top_speed_mps")
        if self.flight_speed_mps is not None and self.flight_speed_mps > self.top_speed_mps:
            raise ValueError("flight_speed_mps must not be above top_speed_mps")
        if unknown := sorted(self.sources.keys() - type(self).model_fields.keys()):
            raise ValueError(f"sources: '{unknown[0]}' is not a key of a profile")
        return self

    @property
    def capacity_wh(self) -> float:
        """Nominal energy of all batteries flown with at once."""
        return self.battery_wh * self.batteries

    @property
    def disc_area_m2(self) -> float:
        """Total disc area of the rotors."""
        return self.rotors * pi * self.rotor_diameter_m**2 / 4

    @property
    def drag_area_m2(self) -> float:
        """Drag coefficient times area, f, of a drag ½ ρ f V²: the drag that balances the maker's tilt at top speed,
        W tan θ; where no tilt is stated, the ratio to the disc area of Zeng, Xu and Zhang 2019."""
        if self.tilt_deg is None:
            return FUSELAGE_DRAG_RATIO * ROTOR_SOLIDITY * self.disc_area_m2
        drag_n = self.mass_kg * GRAVITY_MPS2 * tan(radians(self.tilt_deg))
        return 2 * drag_n / (AIR_KG_M3 * self.top_speed_mps**2)

    def flown_kg(self, payload_kg: float = 0.0) -> float:
        """Take-off mass with the profile's own payload and a further one."""
        return self.mass_kg + self.payload_kg + payload_kg


def parse_aircraft(text: str, where: str, folder: Path | None = None) -> dict[str, AircraftProfile]:
    """The profiles of a YAML file's text, by name.

    Args:
        where: names the file in messages.
        folder: of a user's own file: cameras' files are relative to it, and every profile's camera must be known.

    Raises:
        PaveTwinError: it is not valid YAML, does not hold profiles, or one of them names an unknown camera.
    """
    profiles = {}
    for name, entry in mappings_in("aircraft", text, where):
        camera = entry.get("camera")
        if folder is not None and isinstance(camera, str) and own_file(camera) is not None:
            entry = entry | {"camera": str(folder / camera)}
        profiles[name] = AircraftProfile.parse(entry, where=f"{where}, aircraft '{name}'")
        if folder is not None:
            _check_camera(profiles[name], f"{where}, aircraft '{name}'")
    return profiles


def _check_camera(profile: AircraftProfile, where: str) -> None:
    try:
        find_camera(profile.camera)
    except PaveTwinError as error:
        raise PaveTwinError(f"{where}: camera: {str(error).removeprefix(f'{CAMERAS.key}: ')}") from error


AIRCRAFT: Registry[AircraftProfile] = Registry(
    "aircraft", key="aircraft", group="pavetwin.aircraft", home="pavetwin.uav.database"
)
"""The known profiles; a plugin adds one by `AIRCRAFT.add("name", AircraftProfile(...))`."""


def find_aircraft(name: str) -> AircraftProfile:
    """A profile by its name, or from a YAML file: `my.yaml` (its only aircraft) or `my.yaml:name`.

    Raises:
        PaveTwinError: no such aircraft or file.
    """
    path = own_file(name)
    folder = None if path is None else Path(path).absolute().parent
    return find_entry(AIRCRAFT, lambda text, where: parse_aircraft(text, where, folder), name)


def aircraft_of(settings: MissionSettings) -> AircraftProfile | None:
    """The profile that settings name; None where they name none.

    Raises:
        PaveTwinError: no such aircraft or file.
    """
    return None if settings.aircraft is None else find_aircraft(settings.aircraft)


def camera_name(settings: MissionSettings) -> str:
    """Name of a mission's camera for `find_camera`: that of the settings, else the aircraft's.

    Raises:
        PaveTwinError: there is no such aircraft, or neither is given.
    """
    if settings.camera.model is not None:
        return settings.camera.model
    profile = aircraft_of(settings)
    if profile is None:
        raise PaveTwinError("camera.model: without an aircraft give a camera, for example camera.model=paper.")
    return profile.camera


def camera_of(settings: MissionSettings) -> Camera:
    """The camera of a mission.

    Raises:
        PaveTwinError: there is no such aircraft or camera.
    """
    return find_camera(camera_name(settings))

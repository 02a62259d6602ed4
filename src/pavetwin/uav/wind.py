"""Effects of wind on an aircraft: its rating, its tilt, and the motion of its camera in gusts."""

from math import atan, cos, degrees, pi, radians, sqrt, tan
from typing import Final

from pavetwin.config.mission import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.uav.aircraft import AIR_KG_M3, AIRCRAFT, GRAVITY_MPS2, AircraftProfile, aircraft_of

GUST_HZ: Final = 1.0
"""Frequency at which the size of the motion is computed: our assumption, about an airframe's response time."""

GUSTS: Final = ((0.31, 1.81), (0.73, 3.68), (1.37, 3.48))
"""Frequencies [Hz] and phases [rad] of the gusts, equally strong: ours. No one interval between captures is a period of
all three. Over 200 captures, 0.3 to 5 s apart, their motion has the model's RMS to 20 %, mostly to 10 %."""

GIMBAL_LEAK: Final = 0.02
"""Share of the airframe's swing in tilt that a stabilised camera still makes: an assumption of ours."""

Velocity = tuple[float, float]
"""East and north, m/s."""


def check_wind(settings: MissionSettings) -> None:
    """Refuse wind beyond the aircraft's rating.

    Raises:
        PaveTwinError: the wind, or its gusts, are above the aircraft's limit.
    """
    profile, conditions = aircraft_of(settings), settings.conditions
    if profile is None or conditions.gust_mps <= profile.wind_limit_mps:
        return
    wind = f"a wind of {conditions.wind_mps:g} m/s"
    if conditions.gust_factor > 1:
        wind += f" with gusts of {conditions.gust_mps:g} m/s"
    raise PaveTwinError(
        f"conditions.wind_mps: {wind} is above the {profile.wind_limit_mps:g} m/s that the {profile.title} is rated "
        f"for. Wait for {profile.wind_limit_mps:g} m/s or less, gusts included; "
        f"{_instead(conditions.gust_mps, profile)}. Unless a wind is given the air is calm."
    )


def _instead(wind_mps: float, profile: AircraftProfile) -> str:
    """The registered aircraft rated for a wind, or the highest rating if there is none."""
    limits = {name: AIRCRAFT.get(name).wind_limit_mps for name in AIRCRAFT.names()}
    if fit := [f"{name} ({limit:g} m/s)" for name, limit in limits.items() if limit >= wind_mps]:
        return f"or fly another `aircraft`: {', '.join(fit)}"
    best = max(profile.wind_limit_mps, *limits.values())
    return f"no aircraft known here is rated for more than {best:g} m/s"


def tilt_deg(profile: AircraftProfile, airspeed_mps: float, payload_kg: float = 0.0) -> float:
    """Tilt of the airframe in steady level flight, at which the rotors' thrust balances weight and drag:
    tan θ = ½ ρ f V² / W."""
    weight_n = profile.flown_kg(payload_kg) * GRAVITY_MPS2
    return degrees(atan(AIR_KG_M3 * profile.drag_area_m2 * airspeed_mps**2 / 2 / weight_n))


def off_nadir_deg(profile: AircraftProfile, tilt: float) -> float:
    """Off-nadir angle of the camera at a tilt of the airframe [°], beyond the gimbal's range."""
    return max(0.0, tilt - profile.gimbal.holds_deg)


def gust_course(time_s: float) -> float:
    """Motion in gusts at a moment of a mission, relative to the amplitude of a sine of the same RMS, 1/√2.

    The sum of the sines of `GUSTS`: the same in every mission, at most √3.
    """
    return sum(cos(2 * pi * hz * time_s + phase) for hz, phase in GUSTS) / sqrt(len(GUSTS))


def shake_mps(profile: AircraftProfile, settings: MissionSettings, velocity_mps: Velocity, time_s: float) -> Velocity:
    """Apparent velocity of the ground in the camera due to gusts, at a moment.

    Gusts of ± (gust factor − 1) times the wind speed swing the tilt (θ) and push the airframe along the wind. The
    camera turns with a share of the swing, and with all of it that the gimbal cannot hold, which moves the image by
    altitude times rate; the push moves it by g Δtan θ / 2πf, f = `GUST_HZ`. The motion has the RMS of a sine of this
    amplitude and the course of `gust_course`. Zero without gusts.

    Args:
        velocity_mps: velocity of the UAV over the ground.
    """
    conditions = settings.conditions
    swing_mps = conditions.gust_mps - conditions.wind_mps
    if swing_mps <= 0:
        return 0.0, 0.0
    wind = conditions.wind_velocity_mps
    airspeed = ((velocity_mps[0] - wind[0]) ** 2 + (velocity_mps[1] - wind[1]) ** 2) ** 0.5
    tilts = [
        tilt_deg(profile, max(0.0, airspeed + change), settings.energy.payload_kg)
        for change in (-swing_mps, 0.0, swing_mps)
    ]
    leak = GIMBAL_LEAK if profile.gimbal.axes else 1.0
    held = [tilt - off_nadir_deg(profile, tilt) for tilt in tilts] if profile.gimbal.axes else tilts
    lost = off_nadir_deg(profile, tilts[2]) - off_nadir_deg(profile, tilts[0]) if profile.gimbal.axes else 0.0
    turned_rad = radians(leak * (held[2] - held[0]) / 2 + lost / 2)
    turning_mps = settings.altitude_m * 2 * pi * GUST_HZ * turned_rad
    pushed_mps = GRAVITY_MPS2 * (tan(radians(tilts[2])) - tan(radians(tilts[1]))) / (2 * pi * GUST_HZ)
    along = (turning_mps + pushed_mps) * gust_course(time_s) / conditions.wind_mps
    return along * wind[0], along * wind[1]


def seen_velocity_mps(settings: MissionSettings, velocity_mps: Velocity, time_s: float) -> Velocity:
    """Velocity of the camera over the ground at a moment: the UAV's, plus the motion in gusts.

    Raises:
        PaveTwinError: there is no such aircraft.
    """
    is_gusty = settings.conditions.gust_mps > settings.conditions.wind_mps
    profile = aircraft_of(settings) if is_gusty else None
    if profile is None:
        return velocity_mps
    shaken = shake_mps(profile, settings, velocity_mps, time_s)
    return velocity_mps[0] + shaken[0], velocity_mps[1] + shaken[1]

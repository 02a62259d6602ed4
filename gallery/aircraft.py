"""`python -m gallery.aircraft`: power over airspeed of the known aircraft, with measured values of other sources."""

import argparse
from pathlib import Path
from typing import Final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from pavetwin.uav import AIRCRAFT, AircraftProfile
from pavetwin.uav.energy import airspeeds, rotor_power

COLOURS: Final = ("#1F6FB2", "#C4572E", "#3A8C5F", "#7A4FA3", "#B58900", "#4A4A4A")

TB48D_WH: Final = 129.96

MATRICE_100: Final = AircraftProfile.model_validate(
    {
        "title": "DJI Matrice 100 with one TB48D",
        "camera": "paper",
        "mass_kg": 2.431,
        "rotors": 4,
        "rotor_diameter_m": 0.33,
        "battery_wh": TB48D_WH,
        "flight_time_min": 28,
        "top_speed_mps": 22,
        "tilt_deg": 35,
        "climb_mps": 5,
        "descent_mps": 4,
        "wind_limit_mps": 10,
        "gimbal": {"axes": 0},
        "source": "DJI Matrice 100 specifications; DJI Mobile SDK, Hardware Introduction",
    }
)
"""The airframe of the measurements; the flight time that DJI states for it is taken as its hover time."""

MEASURED_KG: Final = 3.715
"""Take-off mass without payload, Rodrigues et al. 2022."""

LOGGED_KG: Final = 3.29
LOGGED_A: Final = ((0.0, 16.83), (2.0, 16.88), (4.0, 16.20), (6.0, 16.36), (8.0, 16.83))
"""A Matrice 100 with a computer, flown in circles of 25 m: ground speed [m/s] and mean current [A], each over 180 mAh
of the battery's own count, on 3 April 2019 (flight logs of A. Faustino's group, see docs/explanation/aircraft.md)."""

LARGE_QUADROTOR: Final = MATRICE_100.model_copy(
    update={"title": "quadrotor of 12.4 kg", "mass_kg": 12.4, "rotor_diameter_m": 0.7112, "top_speed_mps": 10.0,
            "tilt_deg": 6.2}
)  # fmt: skip
"""Its drag is that of its owners' attitude logs, 1.325 N for 1 m/s."""

LARGE_SHARES: Final = (
    (2.46, 1.0161), (3.51, 1.0267), (4.53, 1.0080), (5.59, 0.9666), (6.42, 1.0036), (7.90, 0.9551), (8.08, 0.9523),
    (9.54, 1.0839), (10.90, 0.9919), (11.09, 1.0236), (12.34, 1.0491),
)  # fmt: skip
"""Ground speed [m/s] and power over that in hover (telemetry of 3 July 2026, see docs/explanation/aircraft.md)."""

CRUISE_W: Final = (68.9, 2.0, 16.8, 15.0)
"""Measured power in cruise, 4 to 12 m/s, is b1 m^1.5/√ρ + b0: b1, its standard error, b0, its standard error (Rodrigues
et al., Patterns 3, 100569, 2022; see docs/explanation/aircraft.md)."""

AIR_KG_M3: Final = 1.2
"""Of the measurements, about."""

FLIGHT_MIN: Final = (
    *((2.355, 99.9, 22), (2.855, 99.9, 17), (3.355, 99.9, 13)),
    *((2.431, 129.96, 28), (2.931, 129.96, 20), (3.431, 129.96, 16)),
)
"""Take-off mass, battery [Wh] and flight time of the Matrice 100, DJI Mobile SDK, Hardware Introduction."""


def aircraft_panel(axes: Axes) -> None:
    """The known aircraft: share of the power in hover, and the makers' times."""
    speeds = airspeeds()
    for colour, profile in zip(COLOURS, AIRCRAFT.values(), strict=False):
        watts = rotor_power(profile, -profile.payload_kg).total_w
        flown = speeds <= profile.top_speed_mps
        style = (0, (4, 4)) if profile.title == "DJI Phantom 4 Pro" else "-"  # it lies on the Phantom 4's
        title = profile.title.removeprefix("DJI ")
        axes.plot(speeds[flown], watts[flown] / watts[0], color=colour, linestyle=style, label=title, zorder=3)
        stated_w = 60 * profile.capacity_wh / profile.flight_time_min
        best = profile.flight_speed_mps or speeds[int(np.argmin(watts[flown]))]
        axes.plot(best, stated_w / watts[0], "o", color=colour, markersize=6)
        if profile.hover_time_min is not None:
            hover_w = 60 * profile.capacity_wh / profile.hover_time_min
            axes.plot(0, hover_w / watts[0], "s", color=colour, markersize=7, clip_on=False)
    axes.plot([], [], "o", color="0.35", label="maker's longest flight")
    axes.plot([], [], "s", color="0.35", label="maker's longest hover")
    axes.set_xlim(0, 23)
    axes.set_ylim(0.6, 2.3)
    axes.set_ylabel("power ÷ power in hover")
    axes.set_title("The profiles, anchored at the makers' times", loc="left", fontsize=10)


def measured_panel(axes: Axes) -> None:
    """A Matrice 100, of which power was measured in flight."""
    speeds = airspeeds()
    watts = rotor_power(MATRICE_100, MEASURED_KG - MATRICE_100.mass_kg).total_w
    hover_w = 60 * TB48D_WH / MATRICE_100.flight_time_min * (MEASURED_KG / MATRICE_100.mass_kg) ** 1.5
    flown = speeds <= 15
    axes.plot(speeds[flown], watts[flown] * hover_w / watts[0], color=COLOURS[0], label="model, 3.72 kg")
    slope, slope_error, rest, rest_error = CRUISE_W
    lift = MEASURED_KG**1.5 / AIR_KG_M3**0.5
    cruise_w, error_w = slope * lift + rest, float(np.hypot(slope_error * lift, rest_error))
    axes.fill_between([4, 12], cruise_w - error_w, cruise_w + error_w, color=COLOURS[1], alpha=0.25, linewidth=0)
    axes.plot([4, 12], [cruise_w, cruise_w], color=COLOURS[1], label="measured in cruise at 4 to 12 m/s")
    hovers = [60 * wh / minutes * (MEASURED_KG / kg) ** 1.5 for kg, wh, minutes in FLIGHT_MIN]
    axes.plot(np.zeros(len(hovers)), hovers, "_", color="0.2", markersize=14, clip_on=False,
              label="DJI's flight times at 2.4 to 3.4 kg,\nscaled by mass$^{1.5}$")  # fmt: skip
    axes.set_xlim(0, 15)
    axes.set_ylim(0, 700)
    axes.set_ylabel("power, W")
    axes.set_title("DJI Matrice 100: model and measurements", loc="left", fontsize=10)


def shares_panel(axes: Axes) -> None:
    """Power over ground speed of two more aircraft, as shares of that in hover."""
    speeds = airspeeds()
    flown = speeds <= 13
    logged = [amperes / LOGGED_A[0][1] for _, amperes in LOGGED_A]
    for colour, profile, payload_kg, name, points in (
        (COLOURS[0], MATRICE_100, LOGGED_KG - MATRICE_100.mass_kg, "Matrice 100, 3.29 kg",
         list(zip([mps for mps, _ in LOGGED_A], logged, strict=True))),
        (COLOURS[1], LARGE_QUADROTOR, 0.0, "quadrotor, 12.4 kg", list(LARGE_SHARES)),
    ):  # fmt: skip
        watts = rotor_power(profile, payload_kg).total_w
        axes.plot(speeds[flown], watts[flown] / watts[0], color=colour, label=f"model, {name}")
        axes.plot(*zip(*points, strict=True), "o", color=colour, markersize=5, label="flight logs")
    axes.set_xlim(0, 13)
    axes.set_ylim(0.7, 1.2)
    axes.set_ylabel("power ÷ power in hover")
    axes.set_title("Two more aircraft, wind not known", loc="left", fontsize=10)


def draw(path: Path) -> None:
    """All panels, as a PNG."""
    figure, panels = plt.subplots(1, 3, figsize=(15, 4.2), layout="constrained")
    for panel, fill in zip(panels, (aircraft_panel, measured_panel, shares_panel), strict=True):
        fill(panel)
        panel.set_xlabel("airspeed, m/s" if fill is not shares_panel else "ground speed, m/s")
        panel.grid(color="0.9")
        panel.spines[["top", "right"]].set_visible(False)
        panel.legend(frameon=False, fontsize=8.5, loc="best")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m gallery.aircraft", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs/images/aircraft.png"), help="file of the picture")
    draw(parser.parse_args().output)


if __name__ == "__main__":
    main()

"""`pavetwin aircraft …`: which there are, and what one can do."""

from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out

if TYPE_CHECKING:
    from pavetwin.uav import AircraftProfile

app = typer.Typer(help="List aircraft, and show one.", no_args_is_help=True)


@app.command("list")
def list_known() -> None:
    """List the known aircraft: flight and hover time in still air, rated wind, camera.

    Figures are the makers'; ~ marks those of the model.

    \b
    pavetwin aircraft list
    """
    from rich.table import Table

    from pavetwin.uav import AIRCRAFT, find_camera
    from pavetwin.uav.energy import rotor_power

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("name", "aircraft", "kg", "flight\nmin", "hover\nmin", "wind\nm/s", "mm a px\nat 10 m"):
        table.add_column(name, justify="left" if name in ("name", "aircraft") else "right", vertical="bottom")
    for name, profile in zip(AIRCRAFT.names(), AIRCRAFT.values(), strict=True):
        power_w, camera = rotor_power(profile).total_w, find_camera(profile.camera)
        minutes = [60 * profile.capacity_wh / watts for watts in (power_w.min(), power_w[0])]
        pixel_mm = 1000 * camera.footprint_m(10.0)[1] / camera.image_px[1]
        stated = (profile.payload_kg == 0, profile.payload_kg == 0 and profile.hover_time_min is not None)
        times = (f"{'' if known else '~'}{each:.0f}" for each, known in zip(minutes, stated, strict=True))
        figures = (f"{profile.flown_kg():.2f}", *times)
        table.add_row(name, profile.title, *figures, f"{profile.wind_limit_mps:g}", f"{pixel_mm:.1f}")
    out.print(table)
    out.line(
        "Times in still air, from full to empty; a mission uses less, see the settings energy.usable and .reserve."
    )
    out.line("~: the model's time, where the maker states none or not with this camera; all else is from data sheets.")


@app.command()
def show(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE.yaml", help="A known aircraft, or your own file.")],
) -> None:
    """Show one aircraft: its maker's figures and where they are from; and the model's power and tilt over airspeed.

    What is printed is a file for an aircraft of your own: change its figures.

    \b
    pavetwin aircraft show mavic3e
    pavetwin aircraft show mavic3e > mine.yaml
    pavetwin aircraft show mine.yaml:mavic3e
    """
    from pathlib import Path

    import yaml

    from pavetwin.uav import find_aircraft, find_camera
    from pavetwin.uav.energy import airspeeds, rotor_power
    from pavetwin.uav.wind import tilt_deg

    profile = find_aircraft(name)
    find_camera(profile.camera)
    entry = {Path(name.rpartition(":")[2]).stem: profile.model_dump(mode="json", exclude_defaults=True)}
    out.line("# The maker's figures, except where the sources say otherwise")
    out.print(yaml.safe_dump(entry, sort_keys=False, allow_unicode=True, width=100).rstrip(), markup=False)
    power_w, speeds = rotor_power(profile).total_w, airspeeds()
    out.line("\n# The model's, from these")
    for line in (*_of_the_model(profile), "", "airspeed m/s  power W  tilt °"):
        out.line(f"# {line}".rstrip())
    for mps in range(0, int(profile.top_speed_mps) + 1, 2):
        row = int(abs(speeds - mps).argmin())
        out.line(f"# {mps:12d} {power_w[row]:8.0f} {tilt_deg(profile, mps):7.1f}")


def _of_the_model(profile: "AircraftProfile") -> list[str]:
    """What no maker states of an aircraft, with where it comes from."""
    from pavetwin.uav.aircraft import FUSELAGE_DRAG_RATIO, ROTOR_SOLIDITY
    from pavetwin.uav.energy import BLADE_SHARE, TIP_MPS, airspeeds, rotor_power

    power_w = rotor_power(profile).total_w
    best, hover_min = int(power_w.argmin()), 60 * profile.capacity_wh / power_w[0]
    anchors = "time" if profile.hover_time_min is None else "times in flight and in hover"
    drag = f"tilt and {profile.top_speed_mps:g} m/s"
    if profile.tilt_deg is None:
        drag = f"{FUSELAGE_DRAG_RATIO * ROTOR_SOLIDITY:g} of the rotors' discs, assumed"
    minutes = 60 * profile.capacity_wh / power_w[best]
    lines = [f"least power at {airspeeds()[best]:.1f} m/s: {minutes:.0f} min (scaled to the maker's {anchors})"]
    if profile.hover_time_min is None or profile.payload_kg:
        lines.append(f"hover: {hover_min:.0f} min (predicted; within 7 % for eight aircraft whose makers state it)")
    return [
        *lines,
        f"drag area: {10_000 * profile.drag_area_m2:.0f} cm² ({drag})",
        f"assumed: blade tips at {TIP_MPS:g} m/s, blade over induced power in hover {BLADE_SHARE:.2f}",
    ]

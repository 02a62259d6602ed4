"""`pavetwin aircraft …`: which there are, and what one can do."""

from typing import Annotated

import typer

from pavetwin.cli.console import out

app = typer.Typer(help="List aircraft, and show one.", no_args_is_help=True)


@app.command("list")
def list_known() -> None:
    """List the known aircraft: flight and hover time in still air, rated wind, camera.

    \b
    pavetwin aircraft list
    """
    from rich.table import Table

    from pavetwin.uav import AIRCRAFT, find_camera
    from pavetwin.uav.energy.rotor import rotor_power

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("name", "aircraft", "kg", "flight\nmin", "hover\nmin", "wind\nm/s", "mm a px\nat 10 m"):
        table.add_column(name, justify="left" if name in ("name", "aircraft") else "right", vertical="bottom")
    for name, profile in zip(AIRCRAFT.names(), AIRCRAFT.values(), strict=True):
        power_w, camera = rotor_power(profile).total_w, find_camera(profile.camera)
        minutes = [60 * profile.capacity_wh / watts for watts in (power_w.min(), power_w[0])]
        pixel_mm = 1000 * camera.footprint_m(10.0)[1] / camera.image_px[1]
        figures = (f"{profile.flown_kg():.2f}", *(f"{each:.0f}" for each in minutes))
        table.add_row(name, profile.title, *figures, f"{profile.wind_limit_mps:g}", f"{pixel_mm:.1f}")
    out.print(table)
    out.line(
        "Times in still air, from full to empty; a mission uses less, see the settings energy.usable and .reserve."
    )


@app.command()
def show(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE.yaml", help="A known aircraft, or your own file.")],
) -> None:
    """Show one aircraft: its figures and where they are from, and power and tilt over airspeed.

    \b
    pavetwin aircraft show mavic3e
    pavetwin aircraft show mine.yaml:survey
    """
    import yaml
    from rich.table import Table

    from pavetwin.uav import find_aircraft, find_camera
    from pavetwin.uav.energy import airspeeds
    from pavetwin.uav.energy.rotor import rotor_power
    from pavetwin.uav.wind import tilt_deg

    profile = find_aircraft(name)
    find_camera(profile.camera)
    figures = profile.model_dump(mode="json", exclude_defaults=True)
    out.print(yaml.safe_dump(figures, sort_keys=False, allow_unicode=True, width=100).rstrip(), markup=False)
    power_w, speeds = rotor_power(profile).total_w, airspeeds()
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("airspeed m/s", "power W", "tilt °"):
        table.add_column(heading, justify="right")
    for mps in range(0, int(profile.top_speed_mps) + 1, 2):
        row = int(abs(speeds - mps).argmin())
        table.add_row(f"{mps}", f"{power_w[row]:.0f}", f"{tilt_deg(profile, mps):.1f}")
    out.print(table)

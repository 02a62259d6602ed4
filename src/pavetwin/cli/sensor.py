"""`pavetwin sensor …`: what sensors there are, and whether one's own keeps the rules."""

from typing import Annotated

import typer

from pavetwin.cli.arguments import Plugins, paths_of
from pavetwin.cli.console import list_registered, out

app = typer.Typer(help="List sensors, and check your own.", no_args_is_help=True)


@app.command("list")
def list_sensors(plugin: Plugins = None) -> None:
    """Name the sensors and what each does.

    \b
    pavetwin sensor list
    pavetwin sensor list --plugin my_things.py
    """
    from pavetwin.plugins import load_plugins
    from pavetwin.sensing import SENSORS

    load_plugins(paths_of(plugin))
    list_registered(SENSORS)


@app.command()
def check(
    sensor: Annotated[str, typer.Argument(metavar="FILE.py:ClassName", help="Your own sensor, or a known one.")],
    plugin: Plugins = None,
) -> None:
    """Try a sensor on many frames: does it keep the rules, in whatever order it is shown them?

    \b
    pavetwin sensor check my_sensor.py:Sharp
    """
    from pavetwin.config.mission import SensingSettings
    from pavetwin.plugins import load_plugins
    from pavetwin.sensing import load_sensor

    load_plugins(paths_of(plugin))
    out.print(f"{load_sensor(SensingSettings(sensor=sensor), 0).name}: keeps the rules.")

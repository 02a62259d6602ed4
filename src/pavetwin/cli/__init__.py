"""The command line: parses, calls, prints. One file a command group; heavy imports wait until a command runs."""

import sys

import typer

from pavetwin.cli.console import fail
from pavetwin.errors import PaveTwinError

app = typer.Typer(
    name="pavetwin",
    help="A digital twin for planning UAV pavement inspection over open traffic.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _register() -> None:
    from pavetwin.cli import traffic, world

    app.add_typer(world.app, name="world")
    app.add_typer(traffic.app, name="traffic")


def main() -> None:
    """Run one command. Exit codes: 0 done, 2 something the user can mend (one plain line), 130 interrupted."""
    _register()
    try:
        app()
    except PaveTwinError as error:
        fail(str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        fail("Interrupted; nothing half-written was left behind.")
        sys.exit(130)

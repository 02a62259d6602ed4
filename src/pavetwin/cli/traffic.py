"""`pavetwin traffic …`: record traffic with SUMO."""

import typer

app = typer.Typer(help="Record traffic over a world with SUMO.", no_args_is_help=True)

"""`pavetwin world …`: build, inspect and draw worlds."""

import typer

app = typer.Typer(help="Build, inspect and draw worlds: streets, buildings, furniture, defects.", no_args_is_help=True)

"""The command line: parses, calls, prints. One file per command group; each command imports what it needs when it
runs."""

import os
import signal
import sys
from importlib import import_module
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException
from typer.main import get_group

from pavetwin.cli.commands import Commands, usage_message
from pavetwin.cli.console import fail, quiet
from pavetwin.errors import PaveTwinError

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells and in typer."""

TERMINATED = 143
"""Exit code after SIGTERM, as in shells."""

COMMANDS = {
    "world": "world:app",
    "traffic": "traffic:app",
    "fly": "fly:fly",
    "replay": "page:replay",
    "plan": "plan:app",
    "aircraft": "registered:aircraft",
    "policy": "registered:policy",
    "sensor": "registered:sensor",
    "defect": "defect:app",
    "pci": "inventory:pci",
    "inventory": "inventory:inventory",
    "handover": "handover:handover",
    "capture": "capture:app",
    "data": "data:app",
    "evaluate": "evaluate:evaluate",
    "compare": "compare:compare",
    "train": "train:train",
    "export": "train:export",
    "detect": "detector:detect",
    "serve": "detector:serve",
    "app": "page:app",
    "experiment": "experiment:app",
    "demo": "demo:demo",
    "doctor": "doctor:doctor",
}
"""Module of this package and the group or function in it, by command."""


class LateGroup(TyperGroup):
    """Commands whose modules are loaded on demand; until then only their names are known."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {name: TyperCommand(name) for name in COMMANDS}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in COMMANDS:
            module, _, member = COMMANDS[cmd_name].partition(":")
            command = getattr(import_module(f"{__name__}.{module}"), member)
            loaded = Commands(rich_markup_mode="rich")
            if isinstance(command, typer.Typer):
                loaded.add_typer(command, name=cmd_name)
            else:
                loaded.command(cmd_name)(command)
            self.commands[cmd_name] = get_group(loaded).commands[cmd_name]
        return super().get_command(ctx, cmd_name)


app = typer.Typer(
    name="pavetwin",
    cls=LateGroup,
    help="A digital twin for planning UAV pavement inspection over open traffic.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from pavetwin._core import __version__

        print(f"PaveTwin {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001 - its callback prints it
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Show the warnings and messages of libraries, as in --verbose fly …")
    ] = False,
) -> None:
    """Options of the program itself."""
    if not verbose and not os.environ.get("PAVETWIN_DEBUG"):
        context.with_resource(quiet())


class _Terminated(BaseException):
    """SIGTERM, as an exception, so that temporary files are cleared on the way out."""


def _terminate(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
    raise _Terminated


def main() -> None:
    """Run one command.

    Exit codes: 0 done, 1 an internal error, a problem found by `doctor`, refused files of a
    dataset, or other results of a mission that was flown again, 2 something the user can fix (one plain
    line), 130 interrupted, 143 terminated.
    """
    sys.exit(_run())


def _run() -> int:
    try:
        signal.signal(signal.SIGTERM, _terminate)
        code = app(standalone_mode=False)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    except TyperException as error:
        message = usage_message(error)
        usage = "" if isinstance(error, typer.BadParameter) else f" See `{_command_of(error)} --help`."
        fail(f"{message}{usage}" if message else "Choose one of these commands.")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except _Terminated:
        code = TERMINATED
    except Exception as error:
        if os.environ.get("PAVETWIN_DEBUG"):
            raise
        fail(
            f"Unexpected failure: {type(error).__name__}: {error}. Please report it; "
            "run with PAVETWIN_DEBUG=1 for the traceback."
        )
        return 1
    if code in (INTERRUPTED, TERMINATED):
        fail(f"{'Interrupted' if code == INTERRUPTED else 'Terminated'}; no partial files are left.")
    return code if isinstance(code, int) else 0


def _command_of(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return context.command_path if context is not None else "pavetwin"

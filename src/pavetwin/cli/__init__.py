"""The command line: parses, calls, prints. One file a command group; a command imports what it needs when it runs."""

import os
import signal
import sys
from importlib import import_module
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command, get_group

from pavetwin.cli.arguments import LoadedPlugins, NamingCommand
from pavetwin.cli.console import fail
from pavetwin.cli.flags import refuse_repeated, with_flags
from pavetwin.cli.hints import words_of
from pavetwin.cli.quiet import quiet
from pavetwin.errors import PaveTwinError

INTERRUPTED = 130
"""The exit code after Ctrl-C: of shells, and what typer makes of a KeyboardInterrupt within a command."""

TERMINATED = 143
"""The exit code after SIGTERM, of shells."""

COMMANDS = (
    *("world", "traffic", "fly", "replay", "plan", "aircraft", "policy", "sensor", "defect", "pci", "inventory"),
    "handover",
    *(
        "capture",
        "data",
        "evaluate",
        "compare",
        "train",
        "export",
        "detect",
        "serve",
        "app",
        "experiment",
        "demo",
        "doctor",
    ),
)
"""Each a module of this package with a group `app`, or a function of its own name."""

MODULES = {"app": "page", "policy": "registered", "sensor": "registered"}
"""Of the commands whose module has another name."""


class LateGroup(TyperGroup):
    """Commands whose modules are loaded when they are asked for; until then only their names are known."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {name: TyperCommand(name) for name in COMMANDS}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in COMMANDS:
            module = import_module(f"{__name__}.{MODULES.get(cmd_name, cmd_name)}")
            command = getattr(module, "app", None) or getattr(module, cmd_name)
            held = typer.Typer(rich_markup_mode="rich")
            if isinstance(command, typer.Typer):
                held.add_typer(command, name=cmd_name)
            else:
                held.command(cmd_name, cls=NamingCommand)(command)
            self.commands[cmd_name] = get_group(held).commands[cmd_name]
            _accept_plugins(self.commands[cmd_name])
        return super().get_command(ctx, cmd_name)


def _accept_plugins(command: Any) -> None:
    """Give a command, or each in a group, `--plugin`; those whose settings name plugins have it already."""
    for inner in getattr(command, "commands", {}).values():
        _accept_plugins(inner)
    if not hasattr(command, "commands") and all(parameter.name != "plugin" for parameter in command.params):
        command.params.append(_plugin_option())


def _plugin_option() -> Any:
    """The option as typer makes it of a function's parameter. It is acted on as it is read, before the command runs."""
    held = typer.Typer(add_completion=False)

    @held.command()
    def _(plugin: LoadedPlugins = None) -> None: ...

    (option,) = get_command(held).params
    option.expose_value = False
    return option


app = typer.Typer(
    name="pavetwin",
    cls=LateGroup,
    help="A digital twin for planning UAV pavement inspection over open traffic.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _say_version(asked: bool) -> None:
    if asked:
        from pavetwin._core import __version__

        print(f"PaveTwin {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    asked: Annotated[  # noqa: ARG001 - its callback has answered
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version.")
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
        refuse_repeated(sys.argv[1:], get_group(app))
        code = app(standalone_mode=False)
    except PaveTwinError as error:
        fail(with_flags(str(error), sys.argv[1:], get_group(app)))
        return 2
    except TyperException as error:
        words = words_of(error)
        fail(f"{words} `{_command_of(error)} --help` lists what there is." if words else "Give one of these commands.")
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
        fail(f"{'Interrupted' if code == INTERRUPTED else 'Terminated'}; nothing half-written was left behind.")
    return code if isinstance(code, int) else 0


def _command_of(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return context.command_path if context is not None else "pavetwin"

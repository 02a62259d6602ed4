"""Commands: help that lists registered names, errors that name the options of the command, and hints."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import typer
from typer.core import TyperCommand
from typer.main import get_command

from pavetwin.errors import PaveTwinError

F = TypeVar("F", bound=Callable[..., Any])

NAMES: Final = {
    "aircraft": ("pavetwin.uav", "AIRCRAFT"),
    "cameras": ("pavetwin.uav", "CAMERAS"),
    "formats": ("pavetwin.capture.formats", "FORMATS"),
    "planformats": ("pavetwin.flightplan", "PLAN_FORMATS"),
    "platforms": ("pavetwin.capture.platforms", "PLATFORMS"),
    "policies": ("pavetwin.policies", "POLICIES"),
    "sensors": ("pavetwin.sensing", "SENSORS"),
    "sources": ("pavetwin.training.datasets.sources", "SOURCES"),
}
"""Registries whose names an option's help may list, as in `{cameras}`: module and registry."""

SUGGESTED: Final = {
    **dict.fromkeys(("--drone", "--uav", "--uas", "--model"), ("--aircraft", "--aircraft")),
    **dict.fromkeys(("--height", "--alt", "--agl"), ("--altitude", "--altitude")),
    **dict.fromkeys(
        ("--battery", "--capacity", "--batteries"), ("--set", "--set energy.usable=0.8, or energy.reserve")
    ),
    **dict.fromkeys(("--camera",), ("--set", "--set camera.model=NAME")),
    **dict.fromkeys(("--street", "--streets"), ("--segment", '--segment "Bell Lane"')),
}
"""Hints for unknown options: the option that a command must have for the hint, and what to type instead."""

IN_METRES: Final = ("--altitude", "--segment-length", "--texel")

NO_NUMBER: Final = "Input should be a valid number"

PLUGIN: Final[Any] = {
    "metavar": "FILE.py",
    "help": "A file that registers your own policies, sensors, defect classes …; may be repeated.",
}
"""Attributes of `--plugin`."""


class Command(TyperCommand):
    """A command that accepts `--plugin` and reports errors in terms of its own options.

    The library names a parameter in backquotes (`altitude_m`). In its place stands the option whose parameter, or which
    itself, has that name (`--altitude`).
    """

    def __init__(self, *positional: Any, **attributes: Any) -> None:
        super().__init__(*positional, **attributes)
        if all(parameter.name != "plugins" for parameter in self.params):
            self.params.append(_plugin_option())

    def format_help(self, ctx: Any, formatter: Any) -> None:
        for option in self.params:
            option.help = re.sub(r"\{([a-z]+)\}", _registered, getattr(option, "help", None) or "")  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        with self._naming_options():
            self._refuse_repeated(args)
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        with self._naming_options():
            return super().invoke(ctx)

    @contextmanager
    def _naming_options(self) -> Iterator[None]:
        try:
            yield
        except PaveTwinError as error:
            raise PaveTwinError(in_options(str(error), self)) from error

    def _refuse_repeated(self, args: list[str]) -> None:
        """Refuse an option that takes one value and is given twice."""
        for each in self.params:
            if getattr(each, "multiple", True) or getattr(each, "is_flag", True):
                continue
            if sum(word.partition("=")[0] in each.opts for word in args) > 1:
                raise PaveTwinError(f"{_longest(each)} is given more than once, and takes one value; give it once.")


class Commands(typer.Typer):
    """A group of commands of one subject."""

    def command(self, name: str | None = None, **attributes: Any) -> Callable[[F], F]:
        return super().command(name, **{"cls": Command, **attributes})


def in_options(text: str, command: Any) -> str:
    """A text of the library with parameters in backquotes replaced by the options of a command."""
    options = [_longest(each) for each in command.params if each.param_type_name == "option"]
    names = {each.name: _longest(each) for each in command.params if each.param_type_name == "option"}
    for name, option in ({option[2:].replace("-", "_"): option for option in options} | names).items():
        text = text.replace(f"`{name}`", option)
    return text


def usage_message(error: Exception) -> str:
    """One sentence about a wrong command line; empty if a group printed its help because no command was given."""
    message = _hint(error) or getattr(error, "format_message", lambda: str(error))()
    option = _longest(getattr(error, "param", None))
    if NO_NUMBER in message:
        unit = " of metres" if option in IN_METRES else ""
        message = f"{option or 'a value'}: give a number{unit}, such as 10, without a unit"
    elif type(error) is typer.BadParameter and option:
        message = f"{option}: {error.message.removeprefix('Value error, ')}"
    message = message.replace("Input should be", "it must be").replace(", unable to parse string as an integer", "")
    return message if not message or message.endswith((".", "?")) else f"{message}."


def _registered(found: re.Match[str]) -> str:
    module, registry = NAMES[found[1]]
    return ", ".join(getattr(import_module(module), registry).names())


def _longest(parameter: Any) -> str:
    options: list[str] = getattr(parameter, "opts", None) or [""]
    return max(options, key=len)


def _hint(error: Exception) -> str:
    typed, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    needed, instead = SUGGESTED.get(typed or "", ("", ""))
    known = {flag for each in getattr(getattr(context, "command", None), "params", ()) for flag in each.opts}
    return f"No such option: {typed} (did you mean {instead}?)" if needed in known else ""


def _load(context: typer.Context, plugins: list[Path] | None) -> None:
    if plugins and not context.resilient_parsing:
        from pavetwin.plugins import load_plugins

        load_plugins(plugins)


@cache
def _plugin_option() -> Any:
    """`--plugin`, which takes effect while the command line is parsed."""
    made = typer.Typer(add_completion=False)

    @made.command()
    def _(plugins: Annotated[list[Path] | None, typer.Option("--plugin", callback=_load, **PLUGIN)] = None) -> None: ...

    (option,) = get_command(made).params
    option.expose_value = False
    return option

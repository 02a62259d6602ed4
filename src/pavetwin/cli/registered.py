"""`pavetwin policy …` and `pavetwin sensor …`: which there are, and whether your own keeps the rules."""

from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any

import typer

from pavetwin.cli.console import out
from pavetwin.cli.sensor_fit import fit
from pavetwin.errors import PaveTwinError, naming
from pavetwin.registry import BrokenRulesError


def _group(kind: str, plural: str, package: str, example: str, load: Callable[[Any, str], Any]) -> typer.Typer:
    """The commands of one registry: `load` makes an instance from the package's module and a name."""
    group = typer.Typer(help=f"List {plural}, and check your own.", no_args_is_help=True)

    @group.command("list", help=_help(f"Name the {plural} and what each does.", f"{kind} list --plugin my_things.py"))
    def list_registered() -> None:
        registry = getattr(import_module(package), plural.upper())
        for name, value in zip(registry.names(), registry.values(), strict=True):
            words = (value.__doc__ or "").split("\n\n")[0]
            out.print(f"[bold]{name}[/]: {' '.join(words.split())}")

    @group.command(help=_help(f"Try a {kind} in many situations: does it keep the rules?", f"{kind} check {example}"))
    def check(
        name: Annotated[str, typer.Argument(metavar="FILE.py:ClassName", help=f"Your own {kind}, or a known one.")],
        verbose: Annotated[bool, typer.Option("--verbose", help="List every rule that it breaks.")] = False,
    ) -> None:
        module = import_module(package)
        with naming({getattr(module, plural.upper()).key: f"{kind} check"}):
            try:
                checked = load(module, name)
            except BrokenRulesError as error:
                if verbose:
                    out.line("\n".join(f"  {rule}" for rule in error.rules))
                    raise
                raise PaveTwinError(str(error).replace(" more).", " more; --verbose lists them).")) from error
            out.print(f"{checked.name}: keeps the rules.")

    return group


def _help(words: str, example: str) -> str:
    return f"{words}\n\n\b\npavetwin {example}"


def _policy(module: Any, name: str) -> Any:
    from pavetwin.config.mission import PolicySettings

    return module.load_policy(name, PolicySettings())


def _sensor(module: Any, name: str) -> Any:
    from pavetwin.config.mission import SensingSettings

    return module.load_sensor(SensingSettings(sensor=name), 0)


policy = _group("policy", "policies", "pavetwin.policies", "my_policy.py:Careful", _policy)
sensor = _group("sensor", "sensors", "pavetwin.sensing", "my_sensor.py:Sharp", _sensor)
sensor.command("fit")(fit)

"""`pavetwin policy …`: what policies there are, and whether one's own keeps the rules."""

from typing import Annotated

import typer

from pavetwin.cli.arguments import Plugins, paths_of
from pavetwin.cli.console import list_registered, out

app = typer.Typer(help="List recovery policies, and check your own.", no_args_is_help=True)


@app.command("list")
def list_policies(plugin: Plugins = None) -> None:
    """Name the policies and what each does.

    \b
    pavetwin policy list
    pavetwin policy list --plugin my_things.py
    """
    from pavetwin.plugins import load_plugins
    from pavetwin.policies import POLICIES

    load_plugins(paths_of(plugin))
    list_registered(POLICIES)


@app.command()
def check(
    policy: Annotated[str, typer.Argument(metavar="FILE.py:ClassName", help="Your own policy, or a known one.")],
    plugin: Plugins = None,
) -> None:
    """Try a policy in many situations: does it keep the rules, and answer the same twice?

    \b
    pavetwin policy check my_policy.py:Careful
    """
    from pavetwin.config.mission import PolicySettings
    from pavetwin.plugins import load_plugins
    from pavetwin.policies import load_policy

    load_plugins(paths_of(plugin))
    out.print(f"{load_policy(policy, PolicySettings()).name}: keeps the rules.")

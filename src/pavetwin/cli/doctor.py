"""`pavetwin doctor`: what is missing on this machine, and the command that fixes it."""

import sys
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from platform import machine, system
from typing import Annotated

import typer

from pavetwin.cli.console import out
from pavetwin.errors import PaveTwinError


@dataclass(frozen=True, slots=True)
class Check:
    """The result of one check. `hint` is empty when all is well."""

    what: str
    found: str
    hint: str = ""


def doctor(
    clear_cache: Annotated[
        bool,
        typer.Option(
            "--clear-cache", help="Empty the cache: recordings, NavMeshes, textures, tiles, placed defects, splits."
        ),
    ] = False,
) -> None:
    """Check what is missing on this machine, and print the command that fixes it. Exit code 1 when something is.

    \b
    pavetwin doctor
    pavetwin doctor --clear-cache
    """
    from pavetwin.uav import AIRCRAFT
    from pavetwin.world import cache

    if clear_cache:
        cache.clear_cache()
    packages = (_package("libsumo", "libsumo"), _package("GeoPackage files (pyogrio)", "pyogrio"))
    checks = [_python(), _kernels(), _sumo(), *packages, _adapter()]
    for check in checks:
        mark = "[red]✗[/]" if check.hint else "[green]✓[/]"
        out.print(f"{mark} {check.what}: {check.found}", soft_wrap=True)
        if check.hint:
            out.print(f"  fix: {check.hint}", markup=False)
    out.line(f"Aircraft: {', '.join(AIRCRAFT.names())} (`pavetwin aircraft list` shows their figures)")
    (worlds, size), most = cache.cache_size(), cache.most_bytes()
    held = f"{worlds} world{'s' * (worlds != 1)}, {size / 1e6:.1f} MB of {most / 1e9:g} GB at most"
    out.line(f"Cache: {cache.cache_folder()}, {held}")
    if any(check.hint for check in checks):
        raise typer.Exit(1)
    out.print("Nothing is missing.")


def _python() -> Check:
    found = f"{sys.version.split()[0]} on {system()} {machine()}"
    return Check("Python", found, "" if sys.version_info >= (3, 11) else "install Python 3.11 or newer")


def _kernels() -> Check:
    try:
        from pavetwin import _core
    except ImportError as error:
        return Check("Rust kernels", f"not built ({error})", "make setup")
    return Check("Rust kernels", f"pavetwin._core {_core.__version__}")


def _sumo() -> Check:
    from pavetwin.world.sumo import run_tool

    try:
        words = run_tool("sumo", ["--version"], doing="asking SUMO for its version")
    except PaveTwinError as error:
        return Check("SUMO", str(error), "pip install eclipse-sumo")
    return Check("SUMO", words.splitlines()[0].removeprefix("Eclipse SUMO sumo ").strip())


def _adapter() -> Check:
    """Only frames need one."""
    from pavetwin.render.adapter import find_adapter

    try:
        return Check("Vulkan adapter for frames", str(find_adapter()))
    except PaveTwinError as error:
        _, _, command = str(error).partition(": ")
        return Check("Vulkan adapter for frames", "none; all but frames works without", command)


def _package(what: str, name: str) -> Check:
    """A package counts when Python finds its code: its metadata may remain when the code is gone."""
    if find_spec(name) is None:
        return Check(what, "missing", f"pip install --force-reinstall {name}")
    return Check(what, version(name))

"""`pavetwin doctor`: what is missing on this machine, and the command that mends it."""

import sys
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from platform import machine, system

import typer

from pavetwin.cli.console import out
from pavetwin.errors import PaveTwinError


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at. `mend` is empty when all is well."""

    what: str
    found: str
    mend: str = ""


def doctor() -> None:
    """Say what is missing on this machine and the command that mends it. Exit code 1 when something is.

    \b
    pavetwin doctor
    """
    findings = [check() for check in (_python, _kernels, _sumo, _libsumo, _geo, _adapter)]
    for finding in findings:
        mark = "[red]✗[/]" if finding.mend else "[green]✓[/]"
        out.print(f"{mark} {finding.what}: {finding.found}", soft_wrap=True)
        if finding.mend:
            out.print(f"  mend it: {finding.mend}", markup=False)
    if any(finding.mend for finding in findings):
        raise typer.Exit(1)
    out.print("All is there.")


def _python() -> Finding:
    found = f"{sys.version.split()[0]} on {system()} {machine()}"
    return Finding("Python", found, "" if sys.version_info >= (3, 11) else "install Python 3.11 or newer")


def _kernels() -> Finding:
    try:
        from pavetwin import _core
    except ImportError as error:
        return Finding("Rust kernels", f"not built ({error})", "make setup")
    return Finding("Rust kernels", f"pavetwin._core {_core.__version__}")


def _sumo() -> Finding:
    from pavetwin.world.sumo import run_tool

    try:
        words = run_tool("sumo", ["--version"], doing="asking SUMO for its version")
    except PaveTwinError as error:
        return Finding("SUMO", str(error), "pip install eclipse-sumo")
    return Finding("SUMO", words.splitlines()[0].removeprefix("Eclipse SUMO sumo ").strip())


def _libsumo() -> Finding:
    return _package("libsumo", "libsumo")


def _geo() -> Finding:
    return _package("GeoPackage files (pyogrio)", "pyogrio")


def _adapter() -> Finding:
    """Only frames need one."""
    from pavetwin.render.adapter import find_adapter

    try:
        return Finding("Vulkan adapter for frames", str(find_adapter()))
    except PaveTwinError as error:
        _, _, command = str(error).partition(": ")
        return Finding("Vulkan adapter for frames", "none; all but frames works without", command)


def _package(what: str, name: str) -> Finding:
    """A package counts when Python finds its code: what pip noted of it may outlive it."""
    if find_spec(name) is None:
        return Finding(what, "missing", f"pip install --force-reinstall {name}")
    return Finding(what, version(name))

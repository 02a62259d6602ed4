"""`pavetwin defect …`: list defect classes, and check your own."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import out
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.defects import DefectKind
    from pavetwin.defects.registry import TriedShape

app = Commands(help="List defect classes, and check your own.", no_args_is_help=True)

ALTITUDES_M = (6.0, 10.0, 15.0)
CAMERA = "paper"

EVEN_SD = 3.0
"""A uniform change of the pavement by fewer of its standard deviations is hard to see (assumed)."""


@app.command("list")
def list_registered() -> None:
    """List the defect classes with a description of each.

    \b
    pavetwin defect list --plugin my_class.py
    """
    from pavetwin.defects import DEFECT_CLASSES

    for name, kind in zip(DEFECT_CLASSES.names(), DEFECT_CLASSES.values(), strict=True):
        words = (kind.generate.__doc__ or "").split("\n\n")[0]
        out.print(f"[bold]{name}[/]: {' '.join(words.split())}")


@app.command()
def check(
    name: Annotated[
        str, typer.Argument(metavar="FILE.py[:name]", help="Your own classes, one of them, or a known class.")
    ],
    verbose: Annotated[bool, typer.Option("--verbose", help="List every rule that a class breaks.")] = False,
) -> None:
    """Draw 50 shapes of a class, and report broken rules, sizes and label thresholds.

    \b
    pavetwin defect check examples/rutting.py
    pavetwin defect check my_class.py:ravelling --verbose
    """
    from pavetwin.defects.registry import tried

    for kind in _classes(name):
        trials, broken = tried(kind)
        if trials:
            out.print(_sizes(kind.name, trials))
            out.line("\n".join(_described(kind, trials)))
        if broken:
            if verbose:
                out.line("\n".join(f"  {rule}" for rule in broken))
            more = "" if verbose or len(broken) == 1 else f" (and {len(broken) - 1} more; --verbose lists them)"
            raise PaveTwinError(f"defect check: the defect class '{kind.name}' breaks a rule: {broken[0]}{more}.")
        out.line(f"{kind.name}: follows all rules.")


def _classes(name: str) -> "list[DefectKind]":
    """The classes of a file, the one that is named after a colon, or a known one.

    Raises:
        PaveTwinError: the file cannot be read or registers no such class; or no class has that name.
    """
    from pavetwin.defects import DEFECT_CLASSES
    from pavetwin.errors import naming, no_such
    from pavetwin.plugins import KEY, load_plugins, registered_in

    path, colon, one = name.rpartition(":")
    file = path if colon and path.endswith(".py") else name
    with naming({KEY: "defect check", DEFECT_CLASSES.key: "defect check"}):
        if not file.endswith(".py"):
            if name not in (known := DEFECT_CLASSES.names()):
                unknown = no_such(DEFECT_CLASSES.what, name, known, key=KEY)
                raise PaveTwinError(f"{unknown} Name a class of your own by its file, as in my_class.py:ravelling.")
            return [DEFECT_CLASSES.get(name)]
        load_plugins([file], check=False)
        own = [known for what, known in registered_in(Path(file)) if what == DEFECT_CLASSES.what]
        if not own:
            raise PaveTwinError(f"{KEY}: '{file}' registers no defect class; it takes one `@defect_class(…)`.")
        if file != name and one not in own:
            raise PaveTwinError(no_such(DEFECT_CLASSES.what, one, own, key=KEY))
        return [DEFECT_CLASSES.get(known) for known in (own if file == name else [one])]


def _sizes(name: str, trials: "Sequence[TriedShape]") -> "Table":
    """Row of each size: least, median and largest of the shapes."""
    from statistics import median

    from rich.table import Table

    rows: tuple[tuple[str, str, Callable[[TriedShape], float], float], ...] = (
        ("extent along", "m", lambda trial: trial.measures.extent_length_m, 1),
        ("extent across", "m", lambda trial: trial.measures.extent_width_m, 1),
        ("length_m", "m", lambda trial: trial.length_m, 1),
        ("width_m", "mm", lambda trial: trial.width_m, 1000),
        ("depth", "mm", lambda trial: trial.measures.depth_m, 1000),
        ("area", "m²", lambda trial: trial.measures.area_m2, 1),
        ("volume", "l", lambda trial: trial.measures.volume_m3, 1000),
    )
    table = Table(title=f"{name}: {len(trials)} shapes", title_justify="left", box=None, pad_edge=False)
    for heading in ("", "least", "median", "largest", "unit"):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right")
    for label, unit, value, scale in rows:
        values = [scale * value(trial) for trial in trials]
        table.add_row(label, *(_short(each) for each in (min(values), median(values), max(values))), unit)
    return table


def _short(value: float) -> str:
    """Number with three digits and no exponent."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _described(kind: "DefectKind", trials: "Sequence[TriedShape]") -> list[str]:
    """Severities, room, and the least size and contrast of labels."""
    from statistics import median

    from pavetwin.uav import find_camera

    rated = Counter(trial.severity.value for trial in trials)
    severities = ", ".join(f"{rated[level]} {level}" for level in ("low", "medium", "high"))
    fitting = sum(trial.has_room for trial in trials)
    label, camera = kind.label, find_camera(CAMERA)
    lines = [
        f"Severity: {severities}. Room on a straight road of two lanes, 7 m wide: {fitting} of {len(trials)}.",
        f"Labelled from {label.least_side_px} px on the longer side, {label.least_short_side_px} px on the shorter, "
        f"{label.least_area_px} px of mask and a contrast of {label.least_contrast:g}. With the camera {CAMERA} the "
        "median shape has (s.d.: standard deviations of the pavement):",
    ]
    along, across, area = (
        median(value)
        for value in zip(
            *((t.measures.extent_length_m, t.measures.extent_width_m, t.measures.area_m2) for t in trials), strict=True
        )
    )
    for altitude_m in ALTITUDES_M:
        pixel_m = camera.ground_resolution_m(altitude_m)
        pixels = area / pixel_m**2
        lines.append(
            f"  from {altitude_m:g} m: {along / pixel_m:.0f} × {across / pixel_m:.0f} px, {pixels:.0f} px of mask; "
            f"{EVEN_SD * pixels ** (1 / 3):.0f} would be its contrast at {EVEN_SD:g} s.d. in each pixel"
        )
    return lines

"""Arguments that several commands share."""

import os
import re
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand

from pavetwin.errors import PaveTwinError, about
from pavetwin.world.folder import CACHE_VARIABLE, check_world

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


class NamingCommand(TyperCommand):
    """A command whose options say in their help which names are registered; read only when help is asked for."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        for option in self.params:
            option.help = re.sub(r"\{([a-z]+)\}", _registered, getattr(option, "help", None) or "")  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)


def _registered(found: re.Match[str]) -> str:
    module, registry = NAMES[found[1]]
    return ", ".join(getattr(import_module(module), registry).names())


def existing_world(context: typer.Context, parameter: typer.CallbackParam, folder: Path | None) -> Path | None:
    """Check a world's folder; the message names the option, where the folder is not an argument."""
    if folder is not None and not context.resilient_parsing:  # a shell that completes a line asks for no errors
        with about(parameter.name or "world") if parameter.param_type_name == "option" else nullcontext():
            check_world(folder)
    return folder


WorldFolder = Annotated[Path, typer.Argument(help="Folder of the world.", callback=existing_world)]
"""Checked before a command loads anything that takes long."""

DatasetFolder = Annotated[Path, typer.Argument(help="Folder of a dataset.")]
Jobs = Annotated[
    int | None,
    typer.Option(
        help="Number of processes that take images; one per core, as far as memory goes, unless given. From 2 on "
        "one more prefetches tiles, or one of them where few images are taken. The images do not depend on it."
    ),
]
SheetFile = Annotated[
    Path | None, typer.Option("--output", "-o", help="The picture; contact-sheet.png in the dataset unless given.")
]
SheetCount = Annotated[int, typer.Option("--count", help="Number of images.")]

OptionalWorldFolder = Annotated[
    Path | None, typer.Argument(help="Folder of the world; may be left out with --again.", callback=existing_world)
]

_PLUGIN: Final[Any] = {
    "metavar": "FILE.py",
    "help": "A file that registers your own policies, sensors, defect classes …; may be repeated.",
}

Plugins = Annotated[list[Path] | None, typer.Option("--plugin", **_PLUGIN)]
"""Of commands whose settings name plugins."""


def _load(context: typer.Context, plugins: list[Path] | None) -> None:
    if plugins and not context.resilient_parsing:
        from pavetwin.plugins import load_plugins

        load_plugins(plugins)


LoadedPlugins = Annotated[list[Path] | None, typer.Option("--plugin", callback=_load, **_PLUGIN)]
"""Of all other commands, see `pavetwin.cli`."""


def _use_cache(folder: Path | None) -> Path | None:
    if folder is not None:
        os.environ[CACHE_VARIABLE] = str(folder.absolute())  # for worker processes, too
    return folder


Los = Annotated[
    str | None,
    typer.Option(
        "--los",
        metavar="A…F",
        help="Traffic by level of service: A free, C stable, E near capacity, F stop and go; as in --los E. One that "
        "the world cannot reach, such as A among traffic lights, is refused with what it reaches.",
    ),
]
Hour = Annotated[
    int | None,
    typer.Option("--hour", metavar="0…23", help="Traffic of an hour of a weekday, as in --hour 8 for 8 to 9 o'clock."),
]
Mix = Annotated[
    str | None,
    typer.Option("--mix", help="Vehicles: europe, north_america, east_asia or south_asia. europe unless given."),
]


def traffic_name(density: str | None, los: str | None, hour: int | None, mix: str | None) -> str | None:
    """The name of the traffic that options ask for, as `density_named` reads it; None where none of them is given.

    Raises:
        PaveTwinError: two of them exclude each other, or a name is not known.
    """
    given = {"--density": density, "--los": los, "--hour": hour}
    named = [option for option, value in given.items() if value is not None]
    if len(named) > 1:
        raise PaveTwinError(f"{' and '.join(named)} exclude each other; give one of them.")
    if not named and mix is None:
        return None
    from pavetwin.traffic.demand import DEFAULT_TRAFFIC, density_named, hour_density, level_density

    base = level_density(los).name if los is not None else hour_density(hour).name if hour is not None else density
    return density_named(base or DEFAULT_TRAFFIC, mix or "").name


CacheFolder = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="FOLDER",
        help=f"Keep recorded traffic and baked NavMeshes there; in {CACHE_VARIABLE} or ~/.cache/pavetwin unless given.",
        callback=_use_cache,
    ),
]


def paths_of(plugins: list[Path] | None) -> tuple[str, ...]:
    """The `--plugin` files as settings hold them."""
    return tuple(str(path.absolute()) for path in plugins or ())


def split_shares(text: str, option: str) -> tuple[float, float, float]:
    """`70/15/15` as shares of train, val and test.

    Raises:
        PaveTwinError: it is something else; the message names the option.
    """
    try:
        train, val, test = (float(part) / 100 for part in text.split("/"))
    except ValueError:
        raise PaveTwinError(
            f"{option} {text}: expected the percentages of train/val/test, for example {option} 70/15/15."
        ) from None
    return train, val, test

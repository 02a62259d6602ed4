"""`pavetwin capture …`: datasets of labelled images."""

import re
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from pavetwin.cli.arguments import (
    CacheFolder,
    DatasetFolder,
    Jobs,
    Mix,
    NamingCommand,
    Plugins,
    SheetCount,
    SheetFile,
    WorldFolder,
    paths_of,
    split_shares,
    traffic_name,
)
from pavetwin.cli.console import out, progress
from pavetwin.cli.parking import Parking, parking_of
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.capture.record import Statistics
    from pavetwin.capture.settings import CaptureSettings
    from pavetwin.mission.inputs import OnProgress


class _MakeByDefault(TyperGroup):
    """`pavetwin capture WORLD …` is `pavetwin capture make WORLD …`."""

    default_command = "make"

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
            args = [self.default_command, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_MakeByDefault,
    help="""Capture a dataset of labelled images of a world, view it, and count what is in it.

    \b
    pavetwin capture worlds/town -o datasets/town --platform uav --images 500 --altitude 6 --altitude 10
    pavetwin capture show datasets/town
    pavetwin capture stats datasets/town

    [bold]pavetwin capture make --help[/] lists the options; `make` itself may be left out.

    Labels are Single Crack, Crocodile Crack, Pothole, Person, Car, and your own classes with --plugin.""",
    no_args_is_help=True,
)

_UAV_ALTITUDES = (6.0, 10.0, 15.0)


@app.command(cls=NamingCommand)
def make(
    world: WorldFolder,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the dataset.")] = None,
    platform: Annotated[
        list[str] | None,
        typer.Option(help="What carries the camera: {platforms}; several with commas. uav unless given."),
    ] = None,
    images: Annotated[
        int, typer.Option(help="Number of images of each platform; a dataset may be extended later.")
    ] = 100,
    altitude: Annotated[
        list[float] | None, typer.Option(help="Of the UAV, in metres; may be repeated. 6, 10 and 15 unless given.")
    ] = None,
    gsd_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="FINEST COARSEST",
            help="Ground resolution of the UAV's images, in millimetres a pixel: crops of the camera's whole frame, "
            "each from the altitude that gives it. With it the camera is phantom4pro unless given.",
        ),
    ] = None,
    los: Annotated[
        list[str] | None,
        typer.Option(metavar="A…F", help="Traffic by level of service; may be repeated. C unless given."),
    ] = None,
    hour: Annotated[
        list[int] | None, typer.Option(metavar="0…23", help="Traffic of an hour of a weekday; may be repeated.")
    ] = None,
    density: Annotated[
        list[str] | None, typer.Option(help="Traffic by density: low, medium, high, or v12-p40; may be repeated.")
    ] = None,
    mix: Mix = None,
    parking: Parking = None,
    seed: Annotated[
        int, typer.Option(help="Random seed of places, light, traffic and parked vehicles; 0 is a seed too.")
    ] = 0,
    size: Annotated[
        str, typer.Option(metavar="WxH", help="Of the images, in pixels; with --gsd-mm of the crops.")
    ] = "640x640",
    camera: Annotated[str | None, typer.Option(help="Of the UAV: {cameras}, or a YAML file.")] = None,
    look: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.yaml", help="Of the streets: varied, uniform, or a YAML file. varied unless given."
        ),
    ] = None,
    formats: Annotated[
        str, typer.Option(help="Label files: any of {formats}, with commas.")
    ] = "yolo,yolo-seg,voc,coco",
    split: Annotated[str, typer.Option(help="Percent of train/val/test, by whole streets.")] = "70/15/15",
    empty: Annotated[float, typer.Option(help="Share of images that must show no defect.")] = 0.15,
    road_users: Annotated[
        float,
        typer.Option(
            help="Share of the UAV's images without defects that are taken of a person or a vehicle. Few people walk "
            "where defects are."
        ),
    ] = 0.0,
    png: Annotated[bool, typer.Option("--png", help="Store images without loss.")] = False,
    quality: Annotated[int, typer.Option(help="Of JPEG, 50 to 100.")] = 92,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    plugin: Plugins = None,
    jobs: Jobs = None,
) -> None:
    """Capture labelled images of a world, or continue an unfinished dataset.

    \b
    pavetwin capture worlds/town -o datasets/town --images 500 --altitude 6 --altitude 10 --los B --los E
    pavetwin capture worlds/town -o datasets/both --platform uav,car --images 200 --seed 3
    pavetwin capture worlds/town -o datasets/parked --parking by-time
    pavetwin capture worlds/town -o datasets/grey --look uniform
    pavetwin capture worlds/town -o datasets/crops --gsd-mm 2 8 --images 500
    pavetwin capture worlds/town -o datasets/people --density high --empty 0.4 --road-users 0.8
    pavetwin capture worlds/town -o datasets/sharp --camera phantom4pro --size 1280x960 --png --formats yolo

    Missing traffic is recorded first. Labels are Single Crack, Crocodile Crack, Pothole, Person and Car, then
    your own defect classes by name, from the file that --plugin gives.
    """
    if output is None:
        raise PaveTwinError("Give the folder of the dataset with -o, for example -o datasets/town.")
    platforms = tuple(name for given in platform or ["uav"] for name in re.split(r"[,\s]+", given.strip()))
    values = {
        "platforms": platforms,
        "images": images,
        "altitudes_m": tuple(altitude or ()),
        "gsd_mm": gsd_mm,
        "densities": _traffics(los or (), hour or (), density or (), mix),
        "seed": seed,
        "size_px": _size(size),
        "camera": camera or ("phantom4pro" if gsd_mm else "paper"),
        "formats": tuple(re.split(r"[,\s]+", formats.strip())),
        "split": split_shares(split, option="--split"),
        "empty": empty,
        "road_users": road_users,
        "picture": "png" if png else "jpg",
        "quality": quality,
        "plugins": paths_of(plugin),
        **({} if look is None else {"look": look}),
        **({} if parking is None else {"parking": parking_of(parking)}),
    }
    with progress("Starting", lines=True) as update:
        # Inside, since these take seconds to import.
        from pavetwin.capture.context import check
        from pavetwin.capture.platforms import flying
        from pavetwin.capture.run import capture
        from pavetwin.capture.scene_renderer import SceneFrameSource
        from pavetwin.capture.settings import settings_of
        from pavetwin.plugins import load_plugins
        from pavetwin.render.adapter import find_adapter

        load_plugins(paths_of(plugin))
        flies = bool(flying(platforms))
        if camera is not None and not flies:
            raise PaveTwinError(f"--camera: a {platforms[0]} has cameras of its own; leave it out.")
        if flies and not altitude and not gsd_mm:
            values["altitudes_m"] = _UAV_ALTITUDES
        settings = settings_of(values, typed={"size_px": size, "split": split})
        check(settings)
        instead = ""
        if not (los or hour or density):
            settings, instead = _in_reach(settings, world, update)
        captured = capture(
            world,
            settings,
            output,
            frame_source_factory=SceneFrameSource,
            adapter=str(find_adapter()),
            jobs=jobs,
            on_progress=update,
        )
    if instead:
        out.line(instead)
    _print(captured.statistics)
    there = settings.total_images - captured.taken
    out.line(
        f"{captured.taken} images taken" + (f", {there} were there" if there else "") + f". Dataset in {output}/. "
        f"Next: pavetwin capture show {quote(str(output))}"
    )


def _traffics(los: Sequence[str], hours: Sequence[int], densities: Sequence[str], mix: str | None) -> tuple[str, ...]:
    """The names of all traffic that is asked for."""
    from pavetwin.traffic.demand import DEFAULT_TRAFFIC

    named = [
        *(traffic_name(None, each, None, mix) for each in los),
        *(traffic_name(None, None, each, mix) for each in hours),
        *(traffic_name(each, None, None, mix) for each in densities),
    ]
    return tuple(dict.fromkeys(name or DEFAULT_TRAFFIC for name in named or [traffic_name(None, None, None, mix)]))


def _in_reach(settings: "CaptureSettings", folder: Path, update: "OnProgress") -> "tuple[CaptureSettings, str]":
    """Settings with the nearest level of service if the world cannot reach the usual one, and a line about it, else
    empty."""
    from pavetwin.cli.report import nearest_line
    from pavetwin.traffic.demand import density_named
    from pavetwin.traffic.demand_search import within_reach
    from pavetwin.world.store import load_world

    world, (usual,) = load_world(folder), map(density_named, settings.densities)
    search = f"Finding the demand of {usual.name}, kept for the next time"
    nearest = within_reach(world, usual, lambda _: update(0.0, search))
    if nearest == usual:
        return settings, ""
    return settings.model_copy(update={"densities": (nearest.name,)}), nearest_line(
        usual.name, nearest.name, world.name
    )


@app.command()
def show(
    dataset: DatasetFolder,
    output: SheetFile = None,
    count: SheetCount = 24,
    split: Annotated[str | None, typer.Option(help="Only of this split: train, val or test.")] = None,
) -> None:
    """Draw a contact sheet of a dataset, with its boxes and masks.

    \b
    pavetwin capture show datasets/town
    pavetwin capture show datasets/town --split val --count 12 -o val.png
    """
    from pavetwin.capture.sheets import save_sheet

    path = output or dataset / "contact-sheet.png"
    with progress("Drawing"):
        drawn = save_sheet(dataset, path, count=count, split=split)
    out.line(f"{drawn} images on {path}")


@app.command()
def stats(dataset: DatasetFolder) -> None:
    """Count what is in a dataset: by class, split, severity and size.

    \b
    pavetwin capture stats datasets/town
    """
    from pavetwin.capture.record import count
    from pavetwin.capture.settings import read_description

    description = read_description(dataset)
    with progress("Counting"):
        statistics = count(dataset)
    settings = description["settings"]
    total, asked = sum(statistics.images.values()), settings["images"] * len(settings["platforms"])
    if total < asked:
        out.print(f"[yellow]Note:[/] {total} of {asked} images are there; run the same command again to continue.")
    _print(statistics)


def _print(statistics: "Statistics") -> None:
    out.print(_labels(statistics))
    by_platform = ", ".join(
        f"{sum(statistics.platforms[name, split] for split in statistics.images)} {name}"
        for name in statistics.platform_names
    )
    out.print(f"images by platform: {by_platform}\n")
    out.print(_kinds(statistics))
    if statistics.ignored:
        out.print()
        out.print(_ignored(statistics))
    if statistics.missed_requests:
        of = f"{statistics.missed_requests} of {sum(statistics.images.values())} images"
        out.print(
            f"\n[yellow]Note:[/] {of} do not show what was requested (a class, or no defect at all): no tried pose "
            "could. In a world with fewer defects more of the road has none, also for images from high altitudes."
        )
    for split, names in statistics.missing_classes().items():
        out.print(
            f"\n[yellow]Note:[/] {split} has no {' and no '.join(names)}. More images may bring some; a world with "
            "more streets, or another --seed, gives more ways to split it.",
            soft_wrap=True,
        )


def _labels(statistics: "Statistics") -> "Table":
    """A row a class: labels by split, and the distinct defects behind them."""
    from pavetwin.labels import SPLITS

    splits = [split for split in SPLITS if statistics.images[split]]
    table = _table("Labels", footer="images\nwithout defects")
    for split in splits:
        table.add_column(split, f"{statistics.images[split]}\n{statistics.empty[split]}", justify="right")
    table.add_column("distinct defects", justify="right")
    for name in statistics.classes:
        behind = [statistics.distinct[name, split] for split in splits if (name, split) in statistics.distinct]
        cells = [str(statistics.labelled[name, split]) for split in splits]
        table.add_row(name, *cells, str(sum(map(len, behind))) if behind else "–")
    return table


def _kinds(statistics: "Statistics") -> "Table":
    """A row a class: labels by severity and by size. Together with the splits they would not fit 80 columns."""
    from pavetwin.capture.record import SIZES

    levels, sizes = ("low", "medium", "high"), tuple(name for name, _ in SIZES)
    table = _table("Labels by severity and size")
    for heading in (*(f"severity\n{level}" for level in levels), *(f"size\n{size}" for size in sizes)):
        table.add_column(heading, justify="right")
    for name in statistics.classes:
        has_severity = any((name, level) in statistics.severities for level in levels)
        cells = [str(statistics.severities[name, level]) if has_severity else "–" for level in levels]
        table.add_row(name, *cells, *(str(statistics.sizes[name, size]) for size in sizes))
    return table


def _ignored(statistics: "Statistics") -> "Table":
    """A row a class: what is seen and not labelled, by reason."""
    from pavetwin.capture.truth import Reason

    table = _table("Ignored")
    for reason in Reason:
        table.add_column(reason.value, justify="right")
    for name in statistics.classes:
        table.add_row(name, *(str(statistics.ignored[name, reason.value]) for reason in Reason))
    return table


def _table(title: str, footer: str = "") -> "Table":
    """A plain table with a column of classes."""
    from rich.table import Table

    table = Table(
        title=title, title_justify="left", box=None, pad_edge=False, header_style="bold", show_footer=bool(footer)
    )
    table.add_column("class", footer, no_wrap=True)
    return table


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)[x×](\d+)", text.strip())
    if found is None:
        raise PaveTwinError(f"--size {text}: expected WIDTHxHEIGHT in pixels, for example --size 640x640.")
    return int(found[1]), int(found[2])

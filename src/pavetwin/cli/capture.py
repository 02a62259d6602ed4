"""`pavetwin capture …`: datasets of labelled images."""

import re
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import out, progress
from pavetwin.cli.options import (
    CacheFolder,
    DatasetFolder,
    Jobs,
    Mix,
    Parking,
    Plugins,
    SheetCount,
    SheetFile,
    TrafficLevel,
    WorldFolder,
    grouped,
    paths_of,
    split_shares,
)
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


app = Commands(
    cls=_MakeByDefault,
    help="""Capture a dataset of labelled images of a world, view it, and count its labels.

    \b
    pavetwin capture worlds/town -o datasets/town --platform uav --images 500 --altitude 6 --altitude 10
    pavetwin capture show datasets/town
    pavetwin capture stats datasets/town

    [bold]pavetwin capture make --help[/] lists the options; `make` itself may be left out.

    Labels are Single Crack, Crocodile Crack, Pothole, Person, Car, and your own classes (--plugin).""",
    no_args_is_help=True,
)

UAV_ALTITUDES_M = (6.0, 10.0, 15.0)


@dataclass(frozen=True)
class CameraOptions:
    """Camera."""

    platforms: Annotated[
        list[str] | None,
        typer.Option("--platform", help="Platform of the camera: {platforms}; several with commas. Default: uav."),
    ] = None
    camera: Annotated[str | None, typer.Option(help="Camera of the UAV: {cameras}, or a YAML file.")] = None
    altitudes_m: Annotated[
        list[float] | None,
        typer.Option("--altitude", help="Altitude of the UAV in metres; may be repeated. Default: 6, 10 and 15."),
    ] = None
    gsd_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="FINEST COARSEST",
            help="Ground resolution of the UAV's images, in millimetres per pixel: crops of full camera images, each "
            "from the altitude of that resolution. The default camera is then phantom4pro.",
        ),
    ] = None
    size_px: Annotated[
        str,
        typer.Option("--size", metavar="WxH", help="Size of the images in pixels; with --gsd-mm, of the crops."),
    ] = "640x640"

    @property
    def platform_names(self) -> tuple[str, ...]:
        return tuple(name for given in self.platforms or ["uav"] for name in _split_names(given))

    def values(self) -> dict[str, Any]:
        """Values of `CaptureSettings`."""
        return {
            "platforms": self.platform_names,
            "camera": self.camera or ("phantom4pro" if self.gsd_mm else "paper"),
            "altitudes_m": tuple(self.altitudes_m or ()),
            "gsd_mm": self.gsd_mm,
            "size_px": _size(self.size_px),
        }


@dataclass(frozen=True)
class CapturedTraffic:
    """Traffic."""

    los: Annotated[
        list[str] | None,
        typer.Option(metavar="A…F", help="Traffic by level of service; may be repeated. Default: C."),
    ] = None
    hour: Annotated[
        list[int] | None, typer.Option(metavar="0…23", help="Traffic of an hour of a weekday; may be repeated.")
    ] = None
    density: Annotated[
        list[str] | None, typer.Option(help="Traffic by density: low, medium, high, or v12-p40; may be repeated.")
    ] = None
    mix: Mix = None

    @property
    def is_given(self) -> bool:
        """Whether an amount of traffic is requested."""
        return bool(self.los or self.hour or self.density)

    def names(self) -> tuple[str, ...]:
        """Names of all requested traffic."""
        from pavetwin.traffic.demand import DEFAULT_TRAFFIC

        levels = [
            *(TrafficLevel(los=each, mix=self.mix) for each in self.los or ()),
            *(TrafficLevel(hour=each, mix=self.mix) for each in self.hour or ()),
            *(TrafficLevel(density=each, mix=self.mix) for each in self.density or ()),
        ]
        return tuple(dict.fromkeys(level.name or DEFAULT_TRAFFIC for level in levels or [TrafficLevel(mix=self.mix)]))


@dataclass(frozen=True)
class ContentOptions:
    """Content of the images."""

    style: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.yaml",
            help="Appearance of the streets: varied (default), uniform, or a YAML file.",
        ),
    ] = None
    parking: Parking = None
    empty: Annotated[float, typer.Option(help="Share of images without any defect.")] = 0.15
    road_users: Annotated[
        float,
        typer.Option(
            help=(
                "Share of the UAV's images without defects that are centred on a person or a vehicle, since few "
                "pedestrians walk near defects."
            )
        ),
    ] = 0.0

    def values(self) -> dict[str, Any]:
        """Values of `CaptureSettings`."""
        return {
            "empty": self.empty,
            "road_users": self.road_users,
            **({} if self.style is None else {"style": self.style}),
            **({} if self.parking is None else {"parking": self.parking.settings()}),
        }


@dataclass(frozen=True)
class FileOptions:
    """Files."""

    formats: Annotated[str, typer.Option(help="Label files: any of {formats}, with commas.")] = "yolo,yolo-seg,voc,coco"
    split: Annotated[str, typer.Option(help="Percentages of train/val/test, by whole streets.")] = "70/15/15"
    png: Annotated[bool, typer.Option("--png", help="Store images losslessly.")] = False
    quality: Annotated[int, typer.Option(help="Quality of JPEG images, 50 to 100.")] = 92

    def values(self) -> dict[str, Any]:
        """Values of `CaptureSettings`."""
        return {
            "formats": _split_names(self.formats),
            "split": split_shares(self.split, "split"),
            "picture": "png" if self.png else "jpg",
            "quality": self.quality,
        }


def _split_names(text: str) -> tuple[str, ...]:
    return tuple(re.split(r"[,\s]+", text.strip()))


@app.command()
@grouped
def make(
    world: WorldFolder,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the dataset.")],
    camera: CameraOptions,
    traffic: CapturedTraffic,
    content: ContentOptions,
    files: FileOptions,
    images: Annotated[
        int, typer.Option(help="Number of images of each platform; a dataset may be extended later.")
    ] = 100,
    seed: Annotated[
        int, typer.Option(help="Random seed of places, light, traffic and parked vehicles; 0 is valid.")
    ] = 0,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    plugins: Plugins = None,
    jobs: Jobs = None,
) -> None:
    """Capture labelled images of a world, or continue an unfinished dataset.

    \b
    pavetwin capture worlds/town -o datasets/town --images 500 --altitude 6 --altitude 10 --los B --los E
    pavetwin capture worlds/town -o datasets/both --platform uav,car --images 200 --seed 3
    pavetwin capture worlds/town -o datasets/parked --parking by-time
    pavetwin capture worlds/town -o datasets/grey --style uniform
    pavetwin capture worlds/town -o datasets/crops --gsd-mm 2 8 --images 500
    pavetwin capture worlds/town -o datasets/people --density high --empty 0.4 --road-users 0.8
    pavetwin capture worlds/town -o datasets/sharp --camera phantom4pro --size 1280x960 --png --formats yolo

    Missing traffic is recorded first. Labels are Single Crack, Crocodile Crack, Pothole, Person and Car, then
    your own defect classes by name, from the file that --plugin gives.
    """
    values = {
        "images": images,
        "seed": seed,
        "plugins": paths_of(plugins),
        **camera.values(),
        **content.values(),
        **files.values(),
        "densities": traffic.names(),
    }
    with progress("Starting", lines=True) as show:
        # Inside the progress bar: these imports take seconds.
        from pavetwin.capture.context import check
        from pavetwin.capture.platforms import flying
        from pavetwin.capture.run import capture
        from pavetwin.capture.scene_renderer import SceneFrameSource
        from pavetwin.capture.settings import settings_of
        from pavetwin.plugins import load_plugins
        from pavetwin.render.adapter import find_adapter

        load_plugins(paths_of(plugins))
        if flying(camera.platform_names):
            values["altitudes_m"] = values["altitudes_m"] or (() if camera.gsd_mm else UAV_ALTITUDES_M)
        elif camera.camera is not None:
            raise PaveTwinError(f"`camera`: a {camera.platform_names[0]} has cameras of its own; leave it out.")
        settings = settings_of(values, typed={"size_px": camera.size_px, "split": files.split})
        check(settings)
        instead = ""
        if not traffic.is_given:
            settings, instead = _in_reach(settings, world, show)
        captured = capture(
            world,
            settings,
            output,
            frame_source_factory=SceneFrameSource,
            adapter=str(find_adapter()),
            jobs=jobs,
            on_progress=show,
        )
    if instead:
        out.line(instead)
    _print(captured.statistics)
    there = settings.total_images - captured.taken
    out.line(
        f"{captured.taken} images taken" + (f", {there} before" if there else "") + f". Dataset in {output}/. "
        f"Next: pavetwin capture show {quote(str(output))}"
    )


def _in_reach(settings: "CaptureSettings", folder: Path, show: "OnProgress") -> "tuple[CaptureSettings, str]":
    """Settings with the nearest level of service where the world cannot reach the usual one, and a line about it; empty
    where it can."""
    from pavetwin.cli.flight_report import nearest_line
    from pavetwin.traffic.demand import density_named
    from pavetwin.traffic.demand_search import within_reach
    from pavetwin.world.store import load_world

    world, (usual,) = load_world(folder), map(density_named, settings.densities)
    search = f"Finding the demand of {usual.name}, cached for later runs"
    nearest = within_reach(world, usual, lambda _: show(0.0, search))
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
    split: Annotated[str | None, typer.Option(help="Only images of this split: train, val or test.")] = None,
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
    """Count the labels of a dataset by class, split, severity and size.

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
        out.print(f"[yellow]Note:[/] {total} of {asked} images are taken; run the same command again to continue.")
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
            f"\n[yellow]Note:[/] {of} do not show what was requested (a class, or no defect at all): no pose was "
            "found. A world with fewer defects has more roads without any, also from high altitudes."
        )
    for split, names in statistics.missing_classes().items():
        out.print(
            f"\n[yellow]Note:[/] {split} has no {' and no '.join(names)}. More images may bring some; a world with "
            "more streets, or another --seed, gives more ways to split it.",
            soft_wrap=True,
        )


def _labels(statistics: "Statistics") -> "Table":
    """One row per class: labels by split, and the number of distinct defects."""
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
    """One row per class: labels by severity and by size, apart from the splits to fit 80 columns."""
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
    """One row per class: objects that are visible but not labelled, by reason."""
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
        raise PaveTwinError(f"`size_px` {text}: expected WIDTHxHEIGHT in pixels, such as 640x640.")
    return int(found[1]), int(found[2])

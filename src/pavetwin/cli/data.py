"""`pavetwin data …`: datasets of photographs, from public sources and your own."""

import re
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import err, out, progress, table
from pavetwin.cli.options import DatasetFolder, Jobs, SheetCount, SheetFile, split_shares
from pavetwin.errors import PaveTwinError, naming, no_such
from pavetwin.reports.words import counted

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.capture.recipe import JoinedImages, SyntheticRecipe, SyntheticSummary
    from pavetwin.labels.common_form import DatasetCounts
    from pavetwin.training.datasets.allocation import CopyPlan
    from pavetwin.training.datasets.balancing import BalanceSummary
    from pavetwin.training.datasets.compositing import CompositeSummary
    from pavetwin.training.datasets.importing import ImportSummary
    from pavetwin.training.datasets.recipe import BuildSummary, Recipe, RecipePack
    from pavetwin.training.datasets.report import Report
    from pavetwin.training.datasets.splitting import SplitShares


NewDataset = Annotated[Path, typer.Option("--output", "-o", help="Folder of the new dataset.")]

REFUSED_CODE = 1
"""Exit code where files of a source were refused; the others are in the dataset."""

SHOWN = 20
"""Lines of a report on the terminal; all are in its file."""

NOTES_SHOWN = 3
"""Notes on the terminal: a merge has one for every two images of one place."""


def print_report(report: "Report", folder: Path) -> None:
    """Print the first lines of a report on the error stream, refusals first, and the path of its file."""
    from pavetwin.training.datasets.report import FILE, UNLABELLED, Finding

    order = list(Finding)
    lines = sorted(report, key=lambda problem: order.index(problem.finding))
    found = [problem for problem in lines if problem.finding is not Finding.NOTE]
    notes = [problem for problem in lines if problem.finding is Finding.NOTE]
    for problem in found[:SHOWN] + notes[:NOTES_SHOWN]:
        err.line(f"{problem.finding.value}: {problem}")
    if lines:
        counts = ", ".join(f"{report.counts[each]} {each.value}" for each in order if report.counts[each])
        more = f" but {report.unlisted}, which are only counted" if report.unlisted else ""
        err.line(f"{counts}; all{more} in {folder / FILE}")
    if report.unlabelled:
        err.line(
            f"Images without a label: {folder / UNLABELLED}. Check them; those that show nothing of any class are "
            "kept as background if this list is given (--background, or `background` of a recipe)."
        )


def splits_table(found: "SplitShares") -> "Table":
    """A row per class: the share of its instances in each split."""
    from pavetwin.labels import SPLITS

    made = table("share of", *(f"{name} %" for name in SPLITS))
    for name, shares in found.shares.items():
        made.add_row(name, *(f"{100 * share:.1f}" for share in shares))
    return made


def balance_table(plan: "CopyPlan") -> "Table":
    """A row per class of the dataset: its instances before and after."""
    from pavetwin.labels.common_form import class_names

    made = table("instances of", "before", "after", "of target %")
    for name, before, after in zip(class_names(), plan.present.tolist(), plan.reached.tolist(), strict=True):
        if before:
            made.add_row(name, str(before), str(after), f"{100 * after / plan.target:.1f}")
    return made


def counts_table(title: str, counts: "DatasetCounts") -> "Table":
    """A row per source, and the sums."""
    from pavetwin.labels.common_form import class_names

    several = len(counts.sources) > 1
    made = table(title=title, title_justify="left", show_footer=several)
    made.add_column("source", "all", no_wrap=True)
    for name in class_names():
        made.add_column(name.replace(" ", "\n"), str(counts.of_class(name)), justify="right", vertical="bottom")
    sums = (
        ("ignored", counts.ignored),
        ("images\nannotated", counts.annotated),
        ("images\nbackground", counts.background),
        ("images\ntotal", counts.annotated + counts.background),
    )
    for heading, counter in sums:
        made.add_column(heading, str(counter.total()), justify="right", vertical="bottom")
    made.add_column("scenes", str(sum(map(len, counts.groups.values()))), justify="right", vertical="bottom")
    for source in counts.sources:
        cells = [counts.instances[source, name] for name in class_names()]
        cells += [counter[source] for _, counter in sums]
        made.add_row(source, *map(str, cells), str(len(counts.groups[source])))
    return made


app = Commands(
    help="""Convert public datasets and your own images into one format, count their labels and view them.

    \b
    pavetwin data sources
    pavetwin data import uav-pdd2023 ~/downloads/UAV-PDD2023 -o datasets/pdd
    pavetwin data stats datasets/pdd
    pavetwin data build recipe.yaml -o datasets/everything

    The five classes are Single Crack, Crocodile Crack, Pothole, Person and Car.""",
    no_args_is_help=True,
)


@app.command("sources")
def list_sources() -> None:
    """List the known sources: home pages, licences, and how their classes are mapped.

    \b
    pavetwin data sources
    """
    from pavetwin.training.datasets.sources import SOURCES

    for name, source in zip(SOURCES.names(), SOURCES.values(), strict=True):
        out.print(f"[bold]{name}[/]: {source.title}", highlight=False)
        out.line(f"  {source.home or 'no page was verified; search for its title'} · licence: {source.licence}")
        becomes: dict[str, list[str]] = {}
        for label, outcome in source.classes.items():
            becomes.setdefault(outcome, []).append(label)
        out.line("  " + "; ".join(f"{', '.join(labels)} → {outcome}" for outcome, labels in becomes.items()))


@app.command("import")
def import_folder(
    source: Annotated[str, typer.Argument(help="{sources}, or a mapping file of your own (mine.yaml).")],
    folder: Annotated[Path, typer.Argument(help="Folder of the unpacked dataset.")],
    output: NewDataset,
    longest: Annotated[int, typer.Option(help="Maximum length of the longer side of images, in pixels.")] = 640,
    tiles: Annotated[
        bool, typer.Option("--tiles", help="Cut larger images into tiles instead: thin cracks vanish when shrunk.")
    ] = False,
    gsd: Annotated[
        float | None, typer.Option(help="Ground resolution of the source in millimetres per pixel, if known.")
    ] = None,
    target_gsd: Annotated[
        float | None,
        typer.Option(help="Ground resolution to scale to, in millimetres per pixel, if that of the source is known."),
    ] = None,
    background: Annotated[
        Path | None,
        typer.Option(help="Text file with one image path per line: images checked to show no object of any class."),
    ] = None,
    quality: Annotated[int, typer.Option(help="JPEG quality, 50 to 100; images that fit are copied unchanged.")] = 92,
) -> None:
    """Convert a source's folder into a dataset of the common format, or continue an unfinished import.

    \b
    pavetwin data import rdd2022-china-drone ~/downloads/China_Drone -o datasets/china
    pavetwin data import uav-pdd2023 ~/downloads/UAV-PDD2023 -o datasets/pdd --tiles
    pavetwin data import mine.yaml ~/photos -o datasets/mine --gsd 2.5 --background checked.txt

    Problems are reported with file and line, and the import continues. Exit code 1 means that files were
    refused, 2 that no image is left. All findings are in report.csv of the dataset.
    """
    from pavetwin.training.datasets.importing import import_source
    from pavetwin.training.datasets.recipe import backgrounds_in
    from pavetwin.training.datasets.resizing import ImageSize
    from pavetwin.training.datasets.sources import source_of

    backgrounds = backgrounds_in(background) if background is not None else frozenset()
    name, found = source_of(source)
    if gsd is not None:
        found = type(found).parse({**dict(found), "gsd_mm": gsd}, where="--gsd")
    values = {"longest_px": longest, "tiles": tiles, "target_gsd_mm": target_gsd, "quality": quality}
    with naming({"longest_px": "--longest", "target_gsd_mm": "--target-gsd", "quality": "--quality"}):
        size = ImageSize.parse(values, where="The images")
    with progress(f"Importing {name}", lines=True) as update:

        def on_image(done: int, total: int) -> None:
            update(min(1.0, done / total), f"Importing {name} {done}/{total}")

        summary = import_source(name, found, folder, output, size=size, backgrounds=backgrounds, on_image=on_image)
    print_report(summary.report, output)
    summary.refuse_empty()
    _end(summary, output, "stats")


def _end(summary: "ImportSummary | BalanceSummary | CompositeSummary", output: Path, then: str) -> None:
    """Print the number of images and the next command.

    Raises:
        typer.Exit: files were refused.
    """
    out.line(f"{counted(summary.images, 'image')} in {output}/. Next: pavetwin data {then} {quote(str(output))}")
    if summary.report.has_refusals:
        raise typer.Exit(REFUSED_CODE)


@app.command()
def merge(
    datasets: Annotated[
        list[Path], typer.Argument(help="Folders of datasets; an image in several is taken from the first.")
    ],
    output: NewDataset,
) -> None:
    """Merge datasets into one, and drop repeated images.

    \b
    pavetwin data merge datasets/china datasets/uapd datasets/cars -o datasets/all

    Images are compared by their content. Those of one place become one scene, which a split keeps together.
    """
    from pavetwin.training.datasets.merging import merge as merged

    with progress("Merging", lines=True) as update:
        summary = merged(datasets, output, on_progress=update)
    print_report(summary.report, output)
    _end(summary, output, "stats")


@app.command()
def balance(
    dataset: DatasetFolder,
    output: NewDataset,
    target: Annotated[
        int | None, typer.Option(help="Minimum number of instances of each class; with --leave-out, the exact number.")
    ] = None,
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Leave images out where copies alone do not make classes equal.")
    ] = False,
    copies: Annotated[int, typer.Option(help="Copies of one image, at most.")] = 50,
    seed: Annotated[int, typer.Option(help="Random seed; 0 is valid.")] = 0,
) -> None:
    """Balance the classes by changed copies of images: flipped, rotated, lighter, noisier.

    \b
    pavetwin data balance datasets/all -o datasets/balanced
    pavetwin data balance datasets/all -o datasets/balanced --target 1000 --leave-out

    Copies belong to the scene of their image. Needs Albumentations: pip install 'pavetwin\\[augment]'.
    """
    from pavetwin.training.datasets.balancing import BalanceSettings
    from pavetwin.training.datasets.balancing import balance as balanced

    values = {"target": target, "leave_out": leave_out, "copies": copies}
    with naming({"target": "--target", "copies": "--copies"}):
        settings = BalanceSettings.parse(values, where="The balance")
    with progress("Balancing", lines=True) as update:
        summary = balanced(dataset, output, settings, seed=seed, on_progress=update)
    print_report(summary.report, output)
    out.print(balance_table(summary.plan))
    _end(summary, output, "show")


@app.command()
def composite(
    dataset: DatasetFolder,
    output: NewDataset,
    objects: Annotated[
        str,
        typer.Option(help="Sources of people and vehicles to cut out, separated by commas, as in uav-cars,uav-people."),
    ] = "uav-cars,uav-people",
    roads: Annotated[
        str,
        typer.Option(
            help="Sources of images that look straight down on roads, separated by commas, as in uav-pdd2023."
        ),
    ] = "",
    share: Annotated[float, typer.Option(help="Percentage of the road images to make composites of.")] = 30.0,
    repeat: Annotated[int, typer.Option(min=1, help="Images that one cut-out stands on, at most.")] = 20,
    road_masks: Annotated[
        Path | None,
        typer.Option(help="Folder of masks NAME.png, white where an image shows road; else colour and texture decide."),
    ] = None,
    shares: Annotated[str, typer.Option(help="Percent of train/val/test, as the dataset will be split.")] = "70/20/10",
    seed: Annotated[int, typer.Option(help="Random seed; 0 is valid.")] = 0,
) -> None:
    """Add images with people and vehicles, cut out of some images, on the roads of others.

    \b
    pavetwin data composite datasets/all -o datasets/mixed --objects uav-cars --roads uav-pdd2023
    pavetwin data composite datasets/all -o datasets/mixed --objects pavetwin --roads uav-pdd2023 --share 20

    Objects are placed only on roads of their own split, so scenes are split first; composites and their objects keep
    that split.

    Ground resolutions must match. Give them with --gsd at the import if you know them; otherwise those of objects
    follow from their usual size, and those of roads from the width of lane lines.
    """
    from pavetwin.training.datasets.compositing import CompositeSettings, compose

    if not roads:
        raise PaveTwinError("Name sources that show roads from above with --roads, for example --roads uav-pdd2023.")
    values = {
        "objects": [name for name in re.split(r"[,\s]+", objects) if name],
        "roads": [name for name in re.split(r"[,\s]+", roads) if name],
        "share": share,
        "repeat": repeat,
        "road_masks": road_masks,
    }
    names = {" share:": " --share:", "`objects`": "--objects", "`roads`": "--roads", "`road_masks`": "--road-masks"}
    with naming(names), progress("Composing", lines=True) as update:
        settings = CompositeSettings.parse(values, where="The composition")
        summary = compose(
            dataset, output, settings, shares=split_shares(shares, "shares"), seed=seed, on_progress=update
        )
    print_report(summary.report, output)
    cut = " and ".join(f"{count} of {name}" for name, count in sorted(summary.cut_outs.items())) or "none"
    out.line(f"Cut-outs: {cut}. Composites: {summary.composites}.")
    _end(summary, output, "show")


@app.command()
def split(
    dataset: DatasetFolder,
    shares: Annotated[str, typer.Option(help="Percent of train/val/test.")] = "70/20/10",
    seed: Annotated[int, typer.Option(help="Random seed; 0 is valid.")] = 0,
) -> None:
    """Split a dataset into train, val and test: each class in the given shares, each scene in one split.

    \b
    pavetwin data split datasets/all
    pavetwin data split datasets/all --shares 80/10/10 --seed 3
    """
    from pavetwin.training.datasets.splitting import LISTS, split_dataset

    with progress("Splitting"):
        found = split_dataset(dataset, split_shares(shares, "shares"), seed)
    print_report(found.report, dataset / LISTS)
    out.print(splits_table(found))


@app.command()
def export(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset after `data split`.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")],
    formats: Annotated[str, typer.Option(help="Any of yolo, yolo-seg, coco, separated by commas.")] = "yolo,coco",
) -> None:
    """Write a split dataset as YOLO (boxes or polygons) or COCO; images are linked.

    \b
    pavetwin data export datasets/all -o datasets/all-yolo --formats yolo
    """
    from pavetwin.training.datasets.exporting import export as exported

    with progress("Exporting", lines=True):
        counts = exported(dataset, output, tuple(re.split(r"[,\s]+", formats.strip())))
    written = ", ".join(f"{count} images as {name}" for name, count in counts.items())
    out.line(f"{written} in {output}/")
    if counts.get("yolo-seg") is not None:
        out.line("yolo-seg holds only images whose labels all have outlines.")


@app.command()
def pack(
    datasets: Annotated[list[Path], typer.Argument(help="Folders with COCO files: exported datasets and captures.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")],
    most_mb: Annotated[float, typer.Option("--max-mb", help="Maximum size of the file, in MB.")] = 60.0,
    quality: Annotated[int, typer.Option(help="WebP quality, 1 to 100; lowered if the file would be too large.")] = 90,
    longest_px: Annotated[
        int | None,
        typer.Option("--longest", help="Maximum length of the longer side of images, in pixels; unchanged by default."),
    ] = None,
    splits: Annotated[str, typer.Option(help="Splits to pack, with commas.")] = "train,val",
) -> None:
    """Pack datasets into one file, to train from it here or on another machine.

    \b
    pavetwin data pack datasets/all-coco datasets/town -o all.pack
    pavetwin data pack datasets/all-coco -o small.pack --max-mb 20 --longest 512
    """
    from pavetwin.labels import SPLITS
    from pavetwin.training.datasets.packs import PackOptions, read_examples, write_pack

    names = tuple(re.split(r"[,\s]+", splits.strip()))
    for name in names:
        if name not in SPLITS:
            raise PaveTwinError(no_such("split", name, SPLITS, key="`splits`"))
    options = PackOptions(most_mb, quality, longest_px or 0)
    with progress("Packing", lines=True) as update:
        summary = write_pack(read_examples(datasets, names), output, options, update)
    out.line(f"{summary.images} images in {output}: {summary.size_mb:.1f} MB at quality {summary.quality}")


@app.command()
def stats(
    datasets: Annotated[list[Path], typer.Argument(help="Folders of datasets.")],
) -> None:
    """Count the images and the instances of each class, by source.

    \b
    pavetwin data stats datasets/pdd datasets/china
    """
    from pavetwin.labels.common_form import count_images, read_description, read_images

    for folder in datasets:
        description = read_description(folder)
        with progress(f"Counting {folder}"):
            counts = count_images(read_images(folder))
        if not description.get("complete"):
            out.print(f"[yellow]Note:[/] {folder} is not finished; run the same command again.", soft_wrap=True)
        out.print(counts_table(str(folder), counts))


@app.command()
def show(
    dataset: DatasetFolder,
    output: SheetFile = None,
    count: SheetCount = 24,
) -> None:
    """Draw a contact sheet of a dataset, with its boxes; ignored regions are dashed.

    \b
    pavetwin data show datasets/pdd
    pavetwin data show datasets/pdd --count 12 -o pdd.jpg
    """
    from pavetwin.draw.contact_sheet import save_dataset_sheet

    path = output or dataset / "contact-sheet.png"
    with progress("Drawing"):
        drawn = save_dataset_sheet(dataset, path, count=count)
    out.line(f"{drawn} images on {path}")


SYNTHETIC_KEYS = ("worlds", "captures")
COCO = "coco"
EXPORTED = "export"


@app.command()
def build(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.yaml", help="File of the recipe.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the stages.")],
    jobs: Jobs = None,
) -> None:
    """Build a dataset from a recipe, or continue a stopped build.

    \b
    pavetwin data build recipe.yaml -o datasets/everything
    pavetwin data build recipes/rendered.yaml -o datasets/rendered

    Photographs are imported, merged, composed, balanced, split and exported:

    \b
    sources:
      - {source: rdd2022-china-drone, folder: downloads/China_Drone}
      - {source: mine.yaml, folder: photos, background: checked.txt, gsd_mm: 2.5}
    size: {longest_px: 640, tiles: true}
    composite: {objects: \\[mine], roads: \\[rdd2022-china-drone]}
    balance: {copies: 50}
    split: [70, 20, 10]
    export: \\[yolo, coco]

    Synthetic images are captured in worlds, each of which belongs to one split:

    \b
    worlds:
      town: {generate: town, streets: {seed: 1}, defects: {population: paper}}
      mine: {map: mine.osm.pbf, split: test}
    captures:
      air: {platforms: \\[uav], images: 300, gsd_mm: [1.5, 12], camera: phantom4pro}
    pack: {most_mb: 60}
    """
    photographs, synthetic, packed = _parts(recipe)
    base = recipe.absolute().parent
    folders, has_refusals = [], False
    if photographs is not None:
        built = _photographs(photographs, base, output)
        has_refusals = any(report.has_refusals for _, report in built.stages)
        if COCO in built.exported:
            folders.append(output / EXPORTED)
    if synthetic is not None:
        folders.append(_synthetic(synthetic, base, output, jobs).folder)
    if packed is not None:
        _pack(packed, folders, output)
    if has_refusals:
        raise typer.Exit(REFUSED_CODE)


def _parts(path: Path) -> "tuple[Recipe | None, SyntheticRecipe | None, RecipePack | None]":
    """The parts of a recipe: photographs, synthetic images and the packed file.

    Raises:
        PaveTwinError: a key or value does not fit.
    """
    from pavetwin.training.datasets.recipe import Recipe, RecipePack, recipe_values

    where = f"the recipe '{path}'"
    values, text = recipe_values(path)
    packed = RecipePack.parse(values.pop("pack") or {}, where=f"{where}: pack") if "pack" in values else None
    of_worlds = {key: values.pop(key) for key in SYNTHETIC_KEYS if key in values}
    synthetic = None
    if of_worlds:
        from pavetwin.capture.recipe import SyntheticRecipe

        seed = {key: value for key, value in values.items() if key == "seed"}
        synthetic = SyntheticRecipe.parse(of_worlds | seed, where, text)
        if values.keys() <= {"seed"}:
            return None, synthetic, packed
    return Recipe.parse(values, where, text), synthetic, packed


def _photographs(recipe: "Recipe", base: Path, output: Path) -> "BuildSummary":
    from pavetwin.labels.common_form import count_images, read_images
    from pavetwin.training.datasets.recipe import build as built
    from pavetwin.training.datasets.splitting import LISTS

    with progress("Building", lines=True) as update:
        summary = built(recipe, base, output, on_stage=update)
    for folder, report in summary.stages:
        print_report(report, folder)
        out.print(counts_table(str(folder), count_images(read_images(folder))))
    if summary.balance is not None:
        out.print(balance_table(summary.balance))
    print_report(summary.shares.report, summary.stages[-1][0] / LISTS)
    out.print(splits_table(summary.shares))
    exported = "".join(f", {count} images as {name}" for name, count in summary.exported.items())
    out.line(f"Built in {output}/{exported}. Next: pavetwin data show {quote(str(summary.stages[-1][0]))}")
    return summary


def _synthetic(recipe: "SyntheticRecipe", base: Path, output: Path, jobs: int | None) -> "SyntheticSummary":
    with progress("Building", lines=True) as update:
        # Inside, since these take seconds to import.
        from pavetwin.capture.recipe import build_synthetic
        from pavetwin.capture.scene_renderer import SceneFrameSource
        from pavetwin.render.adapter import find_adapter

        summary = build_synthetic(
            recipe,
            base,
            output,
            frame_source_factory=SceneFrameSource,
            adapter=str(find_adapter()),
            jobs=jobs,
            on_stage=update,
        )
    out.print(_joined_table(summary.joined))
    total = summary.joined.images.total()
    there = f", {total - summary.taken} were there" if total > summary.taken else ""
    out.line(f"{summary.taken} images taken{there}. Dataset of all worlds in {summary.folder}/")
    return summary


def _pack(settings: "RecipePack", folders: list[Path], output: Path) -> None:
    from pavetwin.training.datasets.recipe import FILE, pack

    if not folders:
        raise PaveTwinError(f"A packed file needs '{COCO}' among the formats of `export`.")
    with progress("Packing", lines=True) as update:
        summary = pack(folders, output / FILE, settings, update)
    out.line(f"{summary.images} images in {output / FILE}: {summary.size_mb:.1f} MB at quality {summary.quality}")


def _joined_table(joined: "JoinedImages") -> "Table":
    """A row per class: its labels by split."""
    from pavetwin.labels import SPLITS

    splits = [split for split in SPLITS if joined.images[split]]
    made = table("labels", *splits)
    for name in dict.fromkeys(name for name, _ in sorted(joined.labelled)):
        made.add_row(name, *(str(joined.labelled[name, split]) for split in splits))
    for heading, counts in (("images", joined.images), ("images without labels", joined.empty)):
        made.add_row(heading, *(str(counts[split]) for split in splits))
    return made

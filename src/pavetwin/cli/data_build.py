"""`pavetwin data build`: photographs of many sources, synthetic images of many worlds, or both, from one file."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.data_tables import REFUSED_CODE, balance_table, counts_table, print_report, splits_table
from pavetwin.cli.options import Jobs
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.capture.recipe import JoinedImages, SyntheticRecipe, SyntheticSummary
    from pavetwin.training.datasets.recipe import BuildSummary, Recipe, RecipePack

SYNTHETIC_KEYS = ("worlds", "captures")
COCO = "coco"
EXPORTED = "export"


def build(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.yaml", help="File of the recipe.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the stages.")] = None,
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
    if output is None:
        raise PaveTwinError("Give the folder of the dataset with -o, for example -o datasets/everything.")
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
    """A row a class: its labels by split."""
    from rich.table import Table

    from pavetwin.labels import SPLITS

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("labels", no_wrap=True)
    splits = [split for split in SPLITS if joined.images[split]]
    for split in splits:
        table.add_column(split, justify="right")
    for name in dict.fromkeys(name for name, _ in sorted(joined.labelled)):
        table.add_row(name, *(str(joined.labelled[name, split]) for split in splits))
    for heading, counts in (("images", joined.images), ("images without labels", joined.empty)):
        table.add_row(heading, *(str(counts[split]) for split in splits))
    return table

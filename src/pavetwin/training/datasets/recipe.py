"""Recipe of a dataset: sources imported, merged, composited and balanced if requested, split, exported and packed.

Every stage has a folder of its own in the output and resumes by itself: a recipe that is run again continues where it
stopped, and the same recipe over the same files gives the same bytes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, field_validator, model_validator
from yaml import YAMLError

from pavetwin.config.settings import PlacedValueError, Settings
from pavetwin.config.text import parse_yaml, why_unread
from pavetwin.errors import PaveTwinError, nearest_name, no_such
from pavetwin.files import working_in
from pavetwin.labels.common_form import write_description
from pavetwin.training.datasets.allocation import CopyPlan
from pavetwin.training.datasets.augmenting import albumentations
from pavetwin.training.datasets.balancing import BalanceSettings, balance
from pavetwin.training.datasets.compositing import CompositeSettings, check_masks, compose
from pavetwin.training.datasets.exporting import FORMATS_OF_EXPORT, export
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.packs import PackOptions, PackSummary, read_examples, write_pack
from pavetwin.training.datasets.report import Report
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.resuming import OnStage, check_same
from pavetwin.training.datasets.sources import DatasetSource, is_mapping_file, source_name, source_of
from pavetwin.training.datasets.splitting import SplitShares, split_dataset

FILE: Final = "all.pack"


class RecipePack(Settings):
    """Packing of a recipe's results into one file."""

    most_mb: float = Field(default=60.0, ge=0.001, le=100_000, description="Millions of bytes, at most.")
    quality: int = Field(default=90, ge=1, le=100, description="WebP quality; lowered if the file would be too large.")
    longest_px: int | None = Field(default=None, ge=32, le=8192, description="Longer side of pictures, at most.")
    splits: tuple[Literal["train", "val", "test"], ...] = Field(
        default=("train", "val"), min_length=1, description="Splits that are packed."
    )


def pack(
    folders: Sequence[Path], file: Path, settings: RecipePack, on_progress: Callable[[float], None] | None = None
) -> PackSummary:
    """Pack folders with COCO files into one file, which replaces one that is there.

    Raises:
        PaveTwinError: there are no images, or they do not fit.
    """
    options = PackOptions(settings.most_mb, settings.quality, settings.longest_px or 0)
    return write_pack(read_examples(folders, settings.splits), file, options, on_progress)


IMPORTS: Final = "imports"
MERGED: Final = "merged"
COMPOSITES: Final = "composites"
BALANCED: Final = "balanced"
EXPORT: Final = "export"

DESCRIPTION: Final = "build.yaml"  # File with the request of a build: another recipe needs another folder


class RecipeSource(Settings):
    """One source of a recipe."""

    source: str = Field(description="A known source, or a mapping file (mine.yaml).")
    folder: Path = Field(description="Folder of the unpacked dataset.")
    background: Path | None = Field(default=None, description="List of pictures that someone has checked.")
    gsd_mm: float | None = Field(default=None, gt=0, le=1000, description="Millimetres a pixel covers, if known.")
    size: ImageSize | None = Field(default=None, description="Size of its images; null: as all others.")


class Recipe(Settings):
    """Sources and stages of a dataset. Paths are relative to the recipe's file."""

    sources: tuple[RecipeSource, ...] = Field(
        min_length=1, description="In the order in which the first picture counts."
    )
    size: ImageSize = Field(default=ImageSize(), description="Size of images.")
    composite: CompositeSettings | None = Field(default=None, description="Composites; null: none.")
    balance: BalanceSettings | None = Field(default=None, description="Balance of classes; null: none.")
    split: tuple[float, float, float] = Field(default=(70.0, 20.0, 10.0), description="Percent of train, val and test.")
    export: tuple[str, ...] = Field(default=("yolo", "coco"), description="Formats; none are allowed.")
    seed: int = Field(default=0, ge=0, description="Random seed of composites, copies and the split.")

    @field_validator("split")
    @classmethod
    def _is_whole(cls, percent: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(percent) < 0 or abs(sum(percent) - 100) > 1e-4:
            raise ValueError(f"train, val and test must sum to 100 percent, none below 0; they sum to {sum(percent):g}")
        return percent

    @model_validator(mode="after")
    def _composes_its_own_sources(self) -> Self:
        known = [source_name(each.source) for each in self.sources]
        for key in ("objects", "roads") if self.composite is not None else ():
            for at, name in enumerate(getattr(self.composite, key)):
                if name not in known:
                    place = f"composite.{key}"
                    words = no_such("source of this recipe", name, known, key=place).removeprefix(f"{place}: ")
                    raise PlacedValueError(("composite", key, at), words.rstrip("."), named=False)
        return self

    @field_validator("export")
    @classmethod
    def _are_known(cls, formats: tuple[str, ...]) -> tuple[str, ...]:
        for name in formats:
            if name not in FORMATS_OF_EXPORT:
                near = nearest_name(name, FORMATS_OF_EXPORT)
                raise ValueError(f"no format '{name}'{near}; known are {', '.join(FORMATS_OF_EXPORT)}")
        return formats


@dataclass(frozen=True)
class BuildSummary:
    """Result of a build: a folder and a report for each stage, in order."""

    stages: tuple[tuple[Path, Report], ...]
    balance: CopyPlan | None
    shares: SplitShares
    exported: dict[str, int]


def recipe_values(path: Path) -> tuple[dict[str, Any], str]:
    """The keys and values of a recipe's file, not checked yet, and its text.

    Raises:
        PaveTwinError: it cannot be read, or holds no keys.
    """
    try:
        text = path.read_text(encoding="utf-8")
        content = parse_yaml(text, where=f"the recipe '{path}'")
    except (OSError, UnicodeDecodeError) as error:
        raise PaveTwinError(f"The recipe '{path}' cannot be read.") from error
    except (YAMLError, ValueError) as error:
        raise PaveTwinError(f"The recipe '{path}' is not valid YAML: {why_unread(error)}.") from error
    if not isinstance(content, dict):
        raise PaveTwinError(f"The recipe '{path}' must hold keys: sources and split, or worlds and captures.")
    return content, text


def build(recipe: Recipe, base: Path, output: Path, *, on_stage: OnStage = lambda _share, _what: None) -> BuildSummary:
    """Make everything in a recipe, or the missing parts.

    Args:
        base: the folder of the recipe's file.

    Raises:
        PaveTwinError: a source cannot be imported, or the output holds the work of another recipe.
    """
    named = _named(recipe.sources, base)
    composite = _placed(recipe.composite, base) if recipe.composite is not None else None
    if recipe.balance is not None:
        albumentations()
    stages: list[tuple[Path, Report]] = []
    asked = recipe.model_dump(mode="json", include={"size", "composite", "balance", "split", "seed"})
    made_by = {"made_by": "build", "sources": [name for name, *_ in named], **asked}
    with working_in(output):
        check_same(output, made_by, DESCRIPTION)
        write_description(output, made_by, DESCRIPTION)
        for folder, (name, source, each, backgrounds) in zip(_folders(named), named, strict=True):

            def on_image(done: int, total: int, name: str = name) -> None:
                on_stage(min(1.0, done / total), f"Importing {name} {done}/{total}")

            imported = import_source(
                name,
                source,
                base / each.folder,
                output / IMPORTS / folder,
                size=each.size or recipe.size,
                backgrounds=backgrounds,
                on_image=on_image,
            )
            imported.refuse_empty()
            stages.append((imported.folder, imported.report))
        merged = merge([folder for folder, _ in stages], output / MERGED, on_progress=on_stage)
        stages.append((merged.folder, merged.report))
        last, plan, shares_asked = merged.folder, None, [percent / 100 for percent in recipe.split]
        if composite is not None:
            composed = compose(
                last, output / COMPOSITES, composite, shares=shares_asked, seed=recipe.seed, on_progress=on_stage
            )
            stages.append((composed.folder, composed.report))
            last = composed.folder
        if recipe.balance is not None:
            balanced = balance(last, output / BALANCED, recipe.balance, seed=recipe.seed, on_progress=on_stage)
            stages.append((balanced.folder, balanced.report))
            last, plan = balanced.folder, balanced.plan
        on_stage(0.0, "Splitting")
        shares = split_dataset(last, shares_asked, recipe.seed)
        on_stage(0.0, "Exporting")
        exported = export(last, output / EXPORT, recipe.export) if recipe.export else {}
    return BuildSummary(tuple(stages), plan, shares, exported)


def _placed(composite: CompositeSettings, folder: Path) -> CompositeSettings:
    """The settings with paths relative to the recipe."""
    masks = folder / composite.road_masks if composite.road_masks is not None else None
    check_masks(masks)
    return composite.model_copy(update={"road_masks": masks})


_Named = tuple[str, DatasetSource, RecipeSource, frozenset[str]]
"""A source's name, itself, its entry in the recipe, and its pictures of verified background."""


def _named(sources: Sequence[RecipeSource], base: Path) -> list[_Named]:
    """Every source; all are found before the first is imported."""
    found = []
    for each in sources:
        if not (base / each.folder).is_dir():
            raise PaveTwinError(f"There is no folder '{base / each.folder}', which the recipe names.")
        name, source = source_of(str(base / each.source) if is_mapping_file(each.source) else each.source)
        if each.gsd_mm is not None:
            source = source.model_copy(update={"gsd_mm": each.gsd_mm})
        listed = backgrounds_in(base / each.background) if each.background is not None else frozenset[str]()
        found.append((name, source, each, listed))
    return found


def _folders(named: Sequence[_Named]) -> list[str]:
    """Names of folders: the sources' own, and a number behind one that is there again."""
    names = [name for name, *_ in named]
    return [name if name not in names[:at] else f"{name}-{names[:at].count(name) + 1}" for at, name in enumerate(names)]


def backgrounds_in(path: Path) -> frozenset[str]:
    """The paths of pictures that a text file lists, one a line.

    Raises:
        PaveTwinError: it cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise PaveTwinError(f"`background`: '{path}' cannot be read as a list of pictures.") from error
    return frozenset(line.strip() for line in lines if line.strip())

"""Synthetic images of many worlds from one file: worlds are built, images of each are captured, and all are joined.

Each world belongs to one split as a whole, so that no street of a test image is in a training image. Every stage
resumes by itself: the same recipe continues where it stopped.
"""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from pavetwin.capture.context import check
from pavetwin.capture.image_workers import FrameSourceFactory
from pavetwin.capture.run import capture
from pavetwin.capture.settings import CaptureSettings
from pavetwin.config.settings import Settings
from pavetwin.defects import DefectOptions
from pavetwin.defects.placement import build_folder
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import file_sha256, link_or_copy, working_in, writing
from pavetwin.labels import SPLITS
from pavetwin.mission.inputs import OnProgress
from pavetwin.plugins import load_plugins
from pavetwin.world.build import BuildOptions
from pavetwin.world.generate import network_kind
from pavetwin.world.store import load_record


@dataclass(frozen=True)
class JoinedImages:
    """Counts of a joined dataset."""

    images: Counter[str] = field(default_factory=Counter)
    """Keyed by split."""
    empty: Counter[str] = field(default_factory=Counter)
    """Images without any label, by split."""
    labelled: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labels by class and split, without what is ignored."""


def join(folders: Sequence[Path], output: Path) -> JoinedImages:
    """Write `annotations/instances_SPLIT.json` of all captures, and link their images. What is there is replaced.

    Each image also names its `capture`.

    Raises:
        PaveTwinError: captures have other classes than the first, or two images the same name.
    """
    found = JoinedImages()
    kinds: list[dict[str, Any]] | None = None
    for split in SPLITS:
        images: list[dict[str, Any]] = []
        annotations: list[dict[str, Any]] = []
        info: dict[str, Any] = {}
        for folder in folders:
            path = folder / "annotations" / f"instances_{split}.json"
            if not path.is_file():
                continue
            content = json.loads(path.read_text(encoding="utf-8"))
            info, kinds = content["info"], kinds or content["categories"]
            if content["categories"] != kinds:
                raise PaveTwinError(f"'{folder}' has other classes than '{folders[0]}'; captures must have the same.")
            numbers = {image["id"]: len(images) + at for at, image in enumerate(content["images"])}
            images += [{**each, "id": numbers[each["id"]], "capture": folder.name} for each in content["images"]]
            first = len(annotations)
            annotations += [
                {**each, "id": first + at + 1, "image_id": numbers[each["image_id"]]}
                for at, each in enumerate(content["annotations"])
            ]
            for each in content["images"]:
                link_or_copy(
                    folder / "images" / split / each["file_name"], output / "images" / split / each["file_name"]
                )
        if not images:
            continue
        if len({each["file_name"] for each in images}) < len(images):
            raise PaveTwinError("Two captures have images of the same name; name every world differently.")
        content = {"info": info, "licenses": [], "categories": kinds, "images": images, "annotations": annotations}
        with writing(output / "annotations" / f"instances_{split}.json") as temporary:
            temporary.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
        names = {each["id"]: each["name"] for each in kinds or ()}
        shown = {each["image_id"] for each in annotations}
        found.images[split] = len(images)
        found.empty[split] = sum(each["id"] not in shown for each in images)
        found.labelled.update((names[each["category_id"]], split) for each in annotations if not each["iscrowd"])
    return found


WORLDS: Final = "worlds"
CAPTURES: Final = "captures"
JOINED: Final = "synthetic"

Name = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
"""Name of a folder."""

Split = Literal["train", "val", "test"]


class RecipeWorld(Settings):
    """One world of a recipe."""

    generate: str | None = Field(default=None, description="Kind of generated streets: town, grid, spider or random.")
    map: Path | None = Field(default=None, description="Instead: a map or a SUMO network, relative to the recipe.")
    split: Split = Field(default="train", description="Split of all images of the world.")
    streets: BuildOptions = Field(default=BuildOptions(), description="Options of the world, with its seed.")
    defects: DefectOptions = Field(default=DefectOptions(), description="Defects of the world.")

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        if (self.generate is None) == (self.map is None):
            raise ValueError("give either generate or map")
        if self.generate is not None:
            network_kind(self.generate)
        return self


class RecipeCapture(CaptureSettings):
    """A capture of every world, or of some."""

    worlds: tuple[Name, ...] = Field(default=(), description="Worlds to capture; default: all.")
    images_of: dict[Split, Annotated[int, Field(ge=1, le=10_000_000)]] = Field(
        default={}, description="Images of each world of a split, in place of `images`: more of what is rare to train."
    )

    def of_world(self, split: Split, seed: int) -> CaptureSettings:
        """Settings for a world, all of whose images belong to one split.

        Args:
            seed: seed of the recipe, used unless the capture has its own.
        """
        given = {name: getattr(self, name) for name in self.model_fields_set - {"images_of", "worlds"}}
        decided = {
            "images": self.images_of.get(split, self.images),
            "split": tuple(float(each == split) for each in SPLITS),
            "seed": given.get("seed", seed),
            "formats": tuple(dict.fromkeys((*given.get("formats", ()), "coco"))),
        }
        return CaptureSettings(**{**given, **decided})


class SyntheticRecipe(Settings):
    """Worlds and captures of synthetic images."""

    worlds: dict[Name, RecipeWorld] = Field(min_length=1, description="Worlds by name.")
    captures: dict[Name, RecipeCapture] = Field(min_length=1, description="Captures by name.")
    seed: int = Field(default=0, ge=0, description="Random seed of places, light, traffic and parked vehicles.")

    @model_validator(mode="after")
    def _leave_to_the_recipe(self) -> Self:
        for name, given in self.captures.items():
            if "split" in given.model_fields_set:
                raise ValueError(f"captures.{name}.split: give the `split` of each world instead")
            for world in given.worlds:
                if world not in self.worlds:
                    raise ValueError(no_such("world", world, self.worlds, key=f"captures.{name}.worlds"))
        return self


@dataclass(frozen=True)
class SyntheticSummary:
    """Result of a build."""

    folder: Path
    """COCO files and images of all worlds."""
    taken: int
    """Images that this call took; the others existed."""
    joined: JoinedImages


def build_synthetic(
    recipe: SyntheticRecipe,
    base: Path,
    output: Path,
    *,
    frame_source_factory: FrameSourceFactory,
    adapter: str = "",
    jobs: int | None = 1,
    on_stage: OnProgress = lambda _share, _what: None,
) -> SyntheticSummary:
    """Build what is missing of the worlds and captures, and join all captures.

    Args:
        base: folder of the recipe's file; maps are relative to it.
        frame_source_factory: makes the frame source of each process.
        adapter: name of the graphics adapter.
        jobs: number of processes that take images, as `capture` has it.
        on_stage: called with the finished share of a stage, and the stage.

    Raises:
        PaveTwinError: a world cannot be built, a capture does not fit, or the output holds the work of another recipe.
    """
    every = [
        (name, what, given.of_world(world.split, recipe.seed))
        for name, world in recipe.worlds.items()
        for what, given in recipe.captures.items()
        if name in (given.worlds or recipe.worlds)
    ]
    for _, _, settings in every:
        load_plugins(tuple(map(Path, settings.plugins)))
        check(settings)
    for name, world in recipe.worlds.items():
        _check_source(output / WORLDS / name, world, base)
    taken, folders = 0, []
    with working_in(output):
        for name, world in recipe.worlds.items():
            _built(output / WORLDS / name, world, base, jobs, on_stage)
        for number, (name, what, settings) in enumerate(every, start=1):
            stage = f"{name}, {what} ({number}/{len(every)})"

            def on_progress(share: float, doing: str, stage: str = stage) -> None:
                on_stage(share, f"{stage}: {doing}")

            folder = output / CAPTURES / f"{name}-{what}"
            done = capture(
                output / WORLDS / name,
                settings,
                folder,
                frame_source_factory=frame_source_factory,
                adapter=adapter,
                jobs=jobs,
                on_progress=on_progress,
            )
            taken += done.taken
            folders.append(folder)
        on_stage(0.0, "Joining")
        joined = join(folders, output / JOINED)
    return SyntheticSummary(output / JOINED, taken, joined)


def _check_source(folder: Path, world: RecipeWorld, base: Path) -> None:
    """Raises:
    PaveTwinError: there is no such map, or another world in the folder.
    """
    if world.map is not None and not (base / world.map).is_file():
        raise PaveTwinError(f"There is no map '{base / world.map}', which the recipe names.")
    if not folder.is_dir():
        return
    record = load_record(folder)
    source = f"generated {world.generate}" if world.map is None else world.map.name
    is_same = (record.source, record.options) == (source, world.streets)
    if world.map is not None:
        is_same &= record.source_sha256 == file_sha256(base / world.map)
    placed = DefectOptions.of_record(record)
    if not world.defects.mix:
        placed = placed.model_copy(update={"mix": {}})
    if not is_same or placed != world.defects:
        raise PaveTwinError(
            f"The world '{folder}' was built differently from the recipe; choose another folder, or remove it."
        )


def _built(folder: Path, world: RecipeWorld, base: Path, jobs: int | None, on_stage: OnProgress) -> None:
    if folder.is_dir():
        return
    stage = f"Building the world {folder.name}"
    source = base / world.map if world.map is not None else network_kind(world.generate or "")
    build_folder(
        source,
        folder,
        world.streets,
        world.defects,
        jobs=jobs,
        on_progress=lambda share, _step: on_stage(share, stage),
    )

"""People and vehicles cut out of images and pasted on the roads of others: new images besides the existing ones.

Every road image draws from the seed and its labels whether it becomes a composite. Its objects also depend on the
composites before it, since each object may appear only so often. Composites are not road images themselves, and an
image with a composite gets no second one. Objects are chosen by split, ground resolution and size.

An object appears on roads of its own split only. Scenes are therefore split first, as `pavetwin data split` does.
Scenes of composites and of their objects keep that split (attribute `splitting.KEPT`); all others may be split
differently later.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from pydantic import Field, field_validator

from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import link_or_copy, staging_folder, working_in
from pavetwin.labels import CUT_OUT, SPLITS
from pavetwin.labels.classes import CAR
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    defect_names,
    filled,
    image_names,
    read_image,
    read_images,
    write_description,
)
from pavetwin.labels.voc import ANNOTATIONS, PICTURES
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.blending import Sun, blended, covered, pasted, turned
from pavetwin.training.datasets.cutouts import (
    CUT_OUTS,
    CutOut,
    StoredCutOut,
    cut_out_all,
    cut_outs,
    ground_resolution,
    read_picture,
)
from pavetwin.training.datasets.pictures import PictureError, opened
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.resizing import scaled_down
from pavetwin.training.datasets.resuming import OnStage, check_same, described, fingerprint, made_ahead, move_in
from pavetwin.training.datasets.road import FreeRoad, marking_gsd_mm, road_direction_deg, road_mask
from pavetwin.training.datasets.splitting import KEPT, USUAL_SHARES, split_groups

SMALLEST: Final = 0.15
"""A cut-out is scaled down to this at most: what is far finer than its place has been seen from much nearer."""

LARGEST: Final = 0.35  # Largest share of a picture that an object may cover

UNKNOWN: Final = "its ground resolution is not known, and nothing in it determines it"
NONE_FITS: Final = "no cut-out has a ground resolution and a size that fit"


@dataclass(frozen=True, slots=True)
class CompositePlan:
    """Plan of one composite."""

    image: AnnotatedImage
    gsd_mm: float = 0.0
    """Ground resolution of the composite: that of the picture, or coarser if it is scaled down for its objects."""
    factor: float = 1.0
    """Scale factor of the image, at most 1."""
    objects: tuple[StoredCutOut, ...] = ()
    reasons: Counter[str] = field(default_factory=Counter)
    """Reasons for fewer objects than drawn."""


def road_gsd_mm(image: AnnotatedImage, picture: UInt8Array, road: BoolArray) -> float | None:
    """Millimetres that a pixel of a road picture covers: as stated, else by its vehicles or its people, else by its
    lane lines."""
    if image.gsd_mm is not None:
        return image.gsd_mm
    by_objects = ground_resolution(image, list(cut_outs(image, picture)))
    return by_objects if by_objects is not None else marking_gsd_mm(picture, road)


class CompositePlanner:
    """Chooses objects for one road image after the other; what it chooses depends on those before.

    An image gets objects of its own split alone, so that none is in train and in test.
    """

    def __init__(
        self,
        library: Sequence[tuple[str, StoredCutOut]],
        splits: Mapping[str, str],
        settings: "CompositeSettings",
    ) -> None:
        """Args:
        library: each with its scene; all with a ground resolution.
        splits: scene → split.
        """
        self._settings, self._splits = settings, splits
        self._libraries = {name: [each for scene, each in library if splits[scene] == name] for name in SPLITS}
        self._uses: Counter[str] = Counter()
        self._asked: Counter[str] = Counter()
        self._short: Counter[str] = Counter()

    def plan(self, image: AnnotatedImage, gsd_mm: float | None, rng: np.random.Generator) -> CompositePlan:
        """Plan the objects on a road image of this ground resolution, and fix its split."""
        split = self._splits[image.group]
        image = replace(image, attributes={**image.attributes, KEPT: split})
        if gsd_mm is None:
            return CompositePlan(image, reasons=Counter([UNKNOWN]))
        plan = self._planned(image, split, gsd_mm, rng)
        self._asked[split] += 1
        self._short[split] += bool(plan.reasons)
        return plan

    def _planned(self, image: AnnotatedImage, split: str, gsd_mm: float, rng: np.random.Generator) -> CompositePlan:
        fitting = [each for each in self._libraries[split] if self._fits(each, image, gsd_mm)]
        if not fitting:
            return CompositePlan(image, reasons=Counter([NONE_FITS]))
        reasons: Counter[str] = Counter()
        chosen: list[StoredCutOut] = []
        categories = sorted({each.category for each in fitting})
        for _ in range(int(rng.integers(1, self._settings.most + 1))):
            category = categories[int(rng.integers(len(categories)))]
            free = [each for each in fitting if each.category == category and each not in chosen]
            if not free:
                reasons[f"no other {category} fits"] += 1
                continue
            least, limit = min(self._uses[each.name] for each in free), self._settings.repeat
            if least >= limit:
                reasons[f"every {category} that fits stands on {limit} images already"] += 1
                continue
            seldom = [each for each in free if self._uses[each.name] == least]
            chosen.append(seldom[int(rng.integers(len(seldom)))])
        self._uses.update(each.name for each in chosen)
        coarsest = max([gsd_mm, *(_known(each) / self._settings.enlarge for each in chosen)])
        return CompositePlan(image, coarsest, gsd_mm / coarsest, tuple(chosen), reasons)

    def _fits(self, cut_out: StoredCutOut, image: AnnotatedImage, gsd_mm: float) -> bool:
        scale = _known(cut_out) / gsd_mm
        width, height = image.size_px
        return (
            SMALLEST <= scale <= self._settings.enlarge * self._settings.reduce
            and cut_out.length_px * scale < max(width, height)
            and cut_out.length_px * cut_out.width_px * scale**2 <= LARGEST * width * height
        )

    def add_shortfalls(self, report: Report) -> None:
        """Report the cut-outs of each split with fewer objects than drawn."""
        for split in (name for name in SPLITS if self._short[name]):
            held = Counter(each.category for each in self._libraries[split])
            own = ", ".join(f"{count} of {name}" for name, count in sorted(held.items())) or "none"
            words = f"{self._short[split]} of its {self._asked[split]} road images have fewer objects than drawn"
            report.add(Finding.NOTE, split, f"{words}; its own cut-outs: {own}, and those of other splits stay there")


def _known(cut_out: StoredCutOut) -> float:
    assert cut_out.gsd_mm is not None
    return cut_out.gsd_mm


THERE: Final = "it has a composite already"

COMPOSITE: Final = "-composite"  # With which the name of a composite ends, after that of its image
COMPOSITE_OF: Final = "composite_of"  # Attribute of a composite: the image whose road it shows

ESTIMATED_GSD: Final = "estimated_gsd_mm"
"""Attribute of a composite whose ground resolution is not known: by what its objects have their size."""

STRAY_DEG: Final = 3.0  # Standard deviation of a vehicle's direction from the road's


class CompositeSettings(Settings):
    """Sources and limits of composites."""

    objects: tuple[str, ...] = Field(min_length=1, description="Sources that people and vehicles are cut out of.")
    roads: tuple[str, ...] = Field(min_length=1, description="Sources whose pictures look straight down on roads.")
    share: float = Field(default=30.0, le=100.0, description="Percent of the road images that become a composite too.")
    most: int = Field(default=3, ge=1, le=20, description="Objects on an image.")
    enlarge: float = Field(default=1.5, ge=1.0, le=4.0, description="An object is scaled up by this at most.")
    reduce: float = Field(
        default=2.0, ge=1.0, le=4.0, description="A road picture is scaled down by this at most, for coarser objects."
    )
    repeat: int = Field(default=20, ge=1, description="Images that one cut-out stands on, at most.")
    gap_m: float = Field(default=0.5, ge=0.0, le=10.0, description="Between objects, on the ground.")
    road_masks: Path | None = Field(
        default=None, description="Folder of masks NAME.png, white where an image shows road; else its look decides."
    )
    quality: int = Field(default=92, ge=50, le=100, description="JPEG quality.")

    @field_validator("share")
    @classmethod
    def _is_percent(cls, percent: float) -> float:
        if not percent >= 1:
            raise ValueError(f"it must be a percentage, from 1 to 100 (got {percent:g})")
        return percent


@dataclass(frozen=True)
class CompositeSummary:
    """Result of a composition."""

    folder: Path
    images: int
    report: Report
    composites: int
    cut_outs: Counter[str]
    """Keyed by class."""


@dataclass(frozen=True, slots=True)
class _Work:
    """A road image that is to become a composite."""

    plan: CompositePlan
    picture: UInt8Array
    road: BoolArray
    rng: np.random.Generator


@dataclass(frozen=True, slots=True)
class _Composite:
    """A new image, or why there is none."""

    image: AnnotatedImage | None = None
    content: bytes = b""
    reasons: Counter[str] = field(default_factory=Counter)


def compose(
    folder: Path,
    output: Path,
    settings: CompositeSettings,
    *,
    shares: Sequence[float] = USUAL_SHARES,
    seed: int = 0,
    on_progress: OnStage = lambda _share, _what: None,
) -> CompositeSummary:
    """A dataset with composites besides its images; what an unfinished run made is kept and not made again.

    Args:
        shares: of train, val and test, as the dataset will be split.

    Raises:
        PaveTwinError: the folder holds no finished dataset or none of the sources, it cannot be split, or the output
            holds another one or cannot be written.
    """
    made_by = {
        "made_by": "composite",
        "dataset": described(folder),
        "settings": settings.model_dump(mode="json"),
        "shares": list(shares),
        "seed": seed,
    }
    if folder.resolve() == output.resolve():
        raise PaveTwinError("The dataset with composites needs a folder of its own.")
    _check_sources(folder, settings)
    check_masks(settings.road_masks)
    if settings.road_masks is not None:
        made_by["masks"] = fingerprint(settings.road_masks)
    on_progress(0.0, "Splitting")
    splits = split_groups(read_images(folder), shares, seed)
    report = Report()
    with working_in(output):
        check_same(output, made_by)
        write_description(output, {**made_by, "complete": False})
        for inner in (PICTURES, ANNOTATIONS, CUT_OUTS):
            (output / inner).mkdir(exist_ok=True)
        with staging_folder(output / "staging") as staging:
            library = cut_out_all(folder, output, staging, settings.objects, report, on_progress)
            planner = CompositePlanner(library, splits.splits, settings)
            composites = _compose(folder, output, staging, planner, settings, seed, report, on_progress)
            scenes = _scenes_of(output, composites, {each.name: scene for scene, each in library})
            given = {scene: splits.splits[scene] for scene in scenes}
            _keep(folder, output, staging, given, on_progress)
        for each in splits.report:
            if each.file in given:
                report.add(Finding.NOTE, each.file, each.text)
        images = len(image_names(output))
        report.save(output / REPORT)
        write_description(output, {**made_by, "complete": True, "images": images})
    return CompositeSummary(output, images, report, len(composites), Counter(each.category for _, each in library))


def check_masks(folder: Path | None) -> None:
    """Refuse masks of roads that are not there.

    Raises:
        PaveTwinError: they are not.
    """
    if folder is not None and not folder.is_dir():
        raise PaveTwinError(f"`road_masks`: there is no folder '{folder}'.")


def _check_sources(folder: Path, settings: CompositeSettings) -> None:
    known = sorted({image.source for image in read_images(folder)})
    for key, names in (("objects", settings.objects), ("roads", settings.roads)):
        for name in names:
            if name not in known:
                raise PaveTwinError(no_such("source of this dataset", name, known, key=f"`{key}`"))


def _compose(
    folder: Path,
    output: Path,
    staging: Path,
    planner: CompositePlanner,
    settings: CompositeSettings,
    seed: int,
    report: Report,
    on_progress: OnStage,
) -> list[str]:
    """Write the composites. Returns the names of all there are now."""
    names = image_names(folder)
    known = set(names)
    tried = Counter[str]()

    def found() -> Iterator[_Work]:
        for done, image in enumerate(read_images(folder), start=1):
            on_progress(done / len(names), f"Composing {done}/{len(names)}")
            rng = _random_numbers(image, seed=seed)
            if image.source not in settings.roads or COMPOSITE_OF in image.attributes:
                continue
            tried["roads"] += 1
            if rng.random() >= settings.share / 100:
                continue
            tried["drawn"] += 1
            if _name(image) in known:
                report.add(Finding.NOTE, image.name, THERE, alike=THERE)
                continue
            try:
                picture = read_picture(folder, image)
                road = _road(image, picture, settings)
            except PictureError as error:
                report.add(Finding.REFUSED, image.name, f"{error}; it becomes no composite")
                continue
            yield _Work(planner.plan(image, road_gsd_mm(image, picture, road), rng), picture, road, rng)

    make = partial(_made, output / CUT_OUTS, settings)
    made = made_ahead(found(), make, exists=lambda work: annotation_path(output, _name(work.plan.image)).is_file())
    composites = [_name(work.plan.image) for work, job in made if _write(work.plan.image, job, output, staging, report)]
    planner.add_shortfalls(report)
    if not composites:
        words = f"{tried['drawn']} of {tried['roads']} road images were drawn for a share of {settings.share:g} %"
        report.add(Finding.NOTE, ", ".join(settings.roads), f"no composites: {words}")
    return composites


def _scenes_of(output: Path, composites: list[str], scene_of: Mapping[str, str]) -> set[str]:
    """The scenes of composites, and those that their objects are of.

    Args:
        scene_of: cut-out → scene.
    """
    images = [read_image(annotation_path(output, name)) for name in composites]
    donors = {
        scene_of[each.attributes[CUT_OUT]] for image in images for each in image.labelled if CUT_OUT in each.attributes
    }
    return donors | {image.group for image in images}


def _keep(folder: Path, output: Path, staging: Path, given: Mapping[str, str], on_progress: OnStage) -> None:
    """Link all images.

    Args:
        given: scene → the split that its images keep.
    """
    names = image_names(folder)
    for done, image in enumerate(read_images(folder), start=1):
        on_progress(done / len(names), f"Linking {done}/{len(names)}")
        if annotation_path(output, image.name).is_file():
            continue
        if (split := given.get(image.group)) is not None:
            image = replace(image, attributes={**image.attributes, KEPT: split})
        link_or_copy(folder / PICTURES / image.picture, output / PICTURES / image.picture)
        move_in(staging, annotation_path(output, image.name), as_xml(image))


def _name(image: AnnotatedImage) -> str:
    return image.name + COMPOSITE


def _random_numbers(image: AnnotatedImage, *, seed: int) -> np.random.Generator:
    """Random numbers of an image; the first decides whether it becomes a composite."""
    return child(seed, Stream.COMPOSITE, int.from_bytes(sha256(as_xml(image)).digest()[:8], "big"))


def _made(cut_out_folder: Path, settings: CompositeSettings, work: _Work) -> _Composite:
    """The composite of a road image."""
    plan, road, rng = work.plan, work.road, work.rng
    reasons, picture = plan.reasons.copy(), work.picture
    if not plan.objects:
        return _Composite(reasons=reasons)
    image = scaled_down(plan.image, plan.factor)
    if plan.factor < 1:
        picture = np.asarray(Image.fromarray(picture).resize(image.size_px, Image.Resampling.BOX))
        road = np.asarray(Image.fromarray(road).resize(image.size_px, Image.Resampling.NEAREST))
    direction_deg = road_direction_deg(picture, road)
    ground = FreeRoad(road, _taken(image), 1000 * settings.gap_m / plan.gsd_mm)
    sun, masks = _sun(image), list[tuple[BoolArray, CutOut]]()
    for each in plan.objects:
        cut_out = each.loaded(cut_out_folder)
        assert cut_out.gsd_mm is not None
        angle_deg = _angle(cut_out, direction_deg, rng)
        shown = turned(cut_out, cut_out.gsd_mm / plan.gsd_mm, angle_deg)
        standing = ground.place(shown.opacity, rng)
        if standing is None:
            reasons["no free place on its road"] += 1
            continue
        picture = blended(picture, shown, standing, cut_out, gsd_mm=plan.gsd_mm, sun=sun)
        ground.take(standing)
        mask = np.zeros(road.shape, dtype=np.bool_)
        mask[standing.window] = shown.opacity > 0.5
        masks.append((mask, cut_out))
    if not masks:
        return _Composite(reasons=reasons)
    held = BytesIO()
    Image.fromarray(picture).save(held, "JPEG", quality=settings.quality, subsampling=0)
    if image.gsd_mm is None:
        image = replace(image, attributes={**image.attributes, ESTIMATED_GSD: f"{plan.gsd_mm:.1f}"})
    return _Composite(_labelled(image, masks, reasons), held.getvalue(), reasons)


def _angle(cut_out: CutOut, direction_deg: float | None, rng: np.random.Generator) -> float:
    """Rotation of an object, clockwise [deg]: vehicles follow the road's direction if it is known."""
    about = float(rng.uniform(0.0, 360.0))
    if cut_out.category != CAR.name or direction_deg is None:
        return about
    return direction_deg - cut_out.angle_deg + (180.0 if about > 180 else 0.0) + float(rng.normal(0.0, STRAY_DEG))


def _road(image: AnnotatedImage, picture: UInt8Array, settings: CompositeSettings) -> BoolArray:
    """Mask of the road in an image: the given mask if there is one, else an estimate."""
    path = settings.road_masks / f"{image.name}.png" if settings.road_masks is not None else None
    if path is None or not path.is_file():
        return road_mask(picture, _filled(image, lambda category: category in defect_names()))
    with opened(path) as file:
        return np.asarray(file.convert("L").resize(image.size_px, Image.Resampling.NEAREST)) > 127


def _taken(image: AnnotatedImage) -> BoolArray:
    """Mask of people, vehicles and ignored regions: everything that is not damage by its class."""
    return _filled(image, lambda category: category not in defect_names())


def _filled(image: AnnotatedImage, is_wanted: Callable[[str | None], bool]) -> BoolArray:
    """Mask of an image's annotations of some classes."""
    covers = np.zeros(image.size_px[::-1], dtype=np.bool_)
    for each in image.annotations:
        if is_wanted(each.category):
            covers |= filled(each, image.size_px)
    return covers


def _sun(image: AnnotatedImage) -> Sun | None:
    """Sun over an image as captures state it; None for photographs."""
    values: list[Any] = [image.attributes.get(key) for key in ("shadow_deg", "sun_elevation_deg", "cloud_cover")]
    return Sun(*map(float, values)) if None not in values else None


def _labelled(image: AnnotatedImage, masks: list[tuple[BoolArray, CutOut]], reasons: Counter[str]) -> AnnotatedImage:
    """The composite's labels: what is covered of the road's own, then the objects."""
    whole = np.logical_or.reduce([mask for mask, _ in masks])
    kept: list[Annotation] = []
    for each in image.annotations:
        left = covered(each, whole, image.size_px)
        if left is None or (left.ignored is not None and each.ignored is None):
            reasons["labels are covered: " + ("gone" if left is None else "ignored")] += 1
        if left is not None:
            kept.append(left)
    objects = (pasted(mask, cut_out.category, cut_out.name) for mask, cut_out in masks)
    return replace(
        image,
        name=_name(image),
        suffix=".jpg",
        is_background=False,
        annotations=(*kept, *objects),
        attributes={**image.attributes, COMPOSITE_OF: image.name},
    )


def _write(image: AnnotatedImage, job: Future[_Composite] | None, output: Path, staging: Path, report: Report) -> bool:
    """Write a composite, if there is one, and keep the reasons for missing objects in a file for the next run."""
    path = output / CUT_OUTS / f"{_name(image)}.json"
    if job is None:
        reasons = Counter[str](json.loads(path.read_text(encoding="utf-8")))
    else:
        try:
            made = job.result()
        except PictureError as error:
            report.add(Finding.REFUSED, image.name, f"{error}; it becomes no composite")
            return False
        reasons = made.reasons
        if made.image is not None:
            move_in(staging, path, json.dumps(reasons, indent=1).encode())
            move_in(staging, output / PICTURES / made.image.picture, made.content)
            move_in(staging, annotation_path(output, made.image.name), as_xml(made.image))
    for reason, count in reasons.items():
        for _ in range(count):
            report.add(Finding.NOTE, image.name, reason, alike=reason)
    return job is None or made.image is not None

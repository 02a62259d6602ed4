"""A dataset in which every class has equally many instances: images are copied, each copy changed.

How often each image is copied is planned for all classes together (`allocation`). What a copy differs in is drawn from
the seed, the image's labels and the copy's number alone, so it depends neither on other images nor on their order.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image
from pydantic import Field

from pavetwin.arrays import Int64Array
from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError
from pavetwin.files import link_or_copy, staging_folder, working_in
from pavetwin.labels.common_form import (
    AnnotatedImage,
    annotation_path,
    as_xml,
    class_names,
    image_names,
    read_image,
    write_description,
)
from pavetwin.labels.voc import ANNOTATIONS, PICTURES
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.allocation import TOLERANCE, CopyPlan, plan_copies
from pavetwin.training.datasets.augmenting import COPY_OF, ImageChange, albumentations, changed, changed_picture
from pavetwin.training.datasets.pictures import PictureError, opened
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.resuming import OnStage, check_same, described, made_ahead, move_in

ATTEMPTS: Final = 8  # Rotations that are drawn for a copy until it shows a label; then it is not rotated

LIGHTER: Final = 0.5
"""Strength of brightness and contrast changes in copies of background, which otherwise are only flipped."""


class BalanceSettings(Settings):
    """Balancing of classes, and changes of copies."""

    target: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="Instances of each class; the fewest by which all are equal if null.",
    )
    leave_out: bool = Field(default=False, description="Leave images out where copies alone make no class equal.")
    copies: int = Field(default=50, ge=0, le=200, description="Copies of one image, at most.")
    rotation_deg: float = Field(default=15.0, ge=0.0, le=15.0, description="To either side, at most.")
    brightness: float = Field(default=0.15, ge=0.0, le=0.5, description="Share of the full scale, at most.")
    contrast: float = Field(default=0.25, ge=0.0, le=0.5, description="Relative change, at most.")
    noise: float = Field(default=0.025, ge=0.0, le=0.2, description="Standard deviation over the full scale, at most.")
    quality: int = Field(default=92, ge=50, le=100, description="JPEG quality.")


@dataclass(frozen=True)
class BalanceSummary:
    """Result of a balance."""

    folder: Path
    images: int
    report: Report
    plan: CopyPlan
    """Classes are those of `class_names()`."""


@dataclass(frozen=True, slots=True)
class _Copy:
    """An image of the new dataset: one that is kept, or a copy of it."""

    source: AnnotatedImage
    made: AnnotatedImage
    change: ImageChange | None = None
    """None if the image is kept unchanged."""


def draw_change(image: AnnotatedImage, number: int, settings: BalanceSettings, seed: int) -> ImageChange:
    """Change of the copy of this number (from 0); a lighter one for background."""
    key = int.from_bytes(sha256(as_xml(image)).digest()[:8], "big")
    rng = child(seed, Stream.BALANCE, key, number)
    strength = LIGHTER if image.is_background else 1.0
    light = (strength * settings.brightness, strength * settings.contrast)
    is_flipped, noise_seed = bool(rng.random() < 0.5), int(rng.integers(2**31))
    brightness, contrast = (round(float(rng.uniform(-most, most)), 3) for most in light)
    if image.is_background:
        return ImageChange(is_flipped, brightness=brightness, contrast=contrast)
    noise = round(float(rng.uniform(0.0, settings.noise)), 4)
    for _ in range(ATTEMPTS):
        rotation_deg = round(float(rng.uniform(-settings.rotation_deg, settings.rotation_deg)), 1)
        change = ImageChange(is_flipped, rotation_deg, brightness, contrast, noise, noise_seed)
        if changed(image, change, image.name).labelled:
            return change
    return ImageChange(is_flipped, 0.0, brightness, contrast, noise, noise_seed)


def instances(image: AnnotatedImage) -> Int64Array:
    """(classes,) The labels of an image by class."""
    numbers = {name: at for at, name in enumerate(class_names())}
    labels = [numbers[each.category] for each in image.labelled if each.category is not None]
    return np.bincount(np.array(labels, dtype=np.intp), minlength=len(numbers)).astype(np.int64)


def balance(
    folder: Path,
    output: Path,
    settings: BalanceSettings,
    *,
    seed: int = 0,
    on_progress: OnStage = lambda _share, _what: None,
) -> BalanceSummary:
    """Balance a dataset into a new one; what an unfinished balance made is kept and not made again.

    Raises:
        PaveTwinError: Albumentations is not installed, the folder holds no finished dataset, or the output holds
            another one or cannot be written.
    """
    albumentations()
    made_by = {"made_by": "balance", "dataset": described(folder), "settings": settings.model_dump(), "seed": seed}
    if folder.resolve() == output.resolve():
        raise PaveTwinError("The balanced dataset needs a folder of its own.")
    report = Report()
    with working_in(output):
        check_same(output, made_by)
        write_description(output, {**made_by, "complete": False})
        for inner in (PICTURES, ANNOTATIONS):
            (output / inner).mkdir(exist_ok=True)
        names = image_names(folder)
        if not names:
            raise PaveTwinError(f"'{folder}' holds no image.")
        read = lru_cache(maxsize=256)(lambda name: read_image(annotation_path(folder, name)))
        plan = _planned(names, read, settings, seed, on_progress)
        _report_shortfalls(plan, settings, report)
        images = 0
        with staging_folder(output / "staging") as staging:
            copies = _copies(names, plan, read, settings, seed, on_progress)
            make = partial(_encoded, folder, quality=settings.quality)
            for work, job in made_ahead(copies, make, exists=partial(_exists, output)):
                images += _write(work, job, folder, output, staging, report)
        report.save(output / REPORT)
        write_description(output, {**made_by, "complete": True, "images": images})
    return BalanceSummary(output, images, report, plan)


def _planned(
    names: list[str], read: Callable[[str], AnnotatedImage], settings: BalanceSettings, seed: int, on_progress: OnStage
) -> CopyPlan:
    """Copies of each image; backgrounds keep their share of the images."""
    counts = np.zeros((len(names), len(class_names())), dtype=np.int64)
    backgrounds = []
    for at, name in enumerate(names):
        on_progress((at + 1) / len(names), f"Counting {at + 1}/{len(names)}")
        image = read(name)
        if COPY_OF in image.attributes:
            raise PaveTwinError(
                f"The dataset holds copies already, such as '{name}'; balance the one that it was made from."
            )
        counts[at] = instances(image)
        if image.is_background:
            backgrounds.append(at)
    known: dict[tuple[int, int], Int64Array] = {}

    def of_copy(at: int, number: int) -> Int64Array:
        if (at, number) not in known:
            image = read(names[at])
            known[at, number] = instances(changed(image, draw_change(image, number, settings, seed), image.name))
        return known[at, number]

    on_progress(0.0, "Planning copies")
    plan = plan_copies(counts, settings.copies, of_copy, target=settings.target, leave_out=settings.leave_out)
    others = len(names) - len(backgrounds)
    if backgrounds and others:
        wanted = round(len(backgrounds) * (others + int(plan.copies.sum())) / others)
        each, more = divmod(max(wanted, len(backgrounds)), len(backgrounds))
        rng = child(seed, Stream.BALANCE)
        once_more = set(rng.permutation(backgrounds)[:more].tolist())
        for at in backgrounds:
            plan.copies[at] = min(each - 1 + (at in once_more), settings.copies)
    return plan


def _report_shortfalls(plan: CopyPlan, settings: BalanceSettings, report: Report) -> None:
    """Report images that the plan leaves out and classes that miss the target, with the reason."""
    left_out = int((plan.copies < 0).sum())
    for _ in range(left_out):
        words = f"left out, so that no class has more than {plan.target} instances"
        report.add(Finding.DROPPED, "images", words, alike="left out")
    for name, words in shortfalls(plan, settings.copies).items():
        report.add(Finding.NOTE, name, words)


def shortfalls(plan: CopyPlan, most: int) -> Mapping[str, str]:
    """Reason for each class that is not balanced, by name."""
    reasons = {}
    least = (1 - TOLERANCE) * float(plan.reached.max(initial=0))
    for at, name in enumerate(class_names()):
        present, reached, can = (int(values[at]) for values in (plan.present, plan.reached, plan.can_reach))
        if not present:
            reasons[name] = "the dataset shows none, so it cannot be balanced"
        elif reached >= least:
            continue
        elif can < plan.target:
            words = f"{present} instances become at most {can} with {most} copies of each image"
            reasons[name] = f"{reached} of {plan.target}: {words}; more `copies` help"
        else:
            words = "images that show it show more frequent classes too"
            reasons[name] = f"{reached} of {plan.target}: {words}; images that show it alone help, or `leave_out`"
    return reasons


def _copies(
    names: list[str],
    plan: CopyPlan,
    read: Callable[[str], AnnotatedImage],
    settings: BalanceSettings,
    seed: int,
    on_progress: OnStage,
) -> Iterator[_Copy]:
    """The images that are kept, each with its copies behind it."""
    for done, (name, number) in enumerate(zip(names, plan.copies.tolist(), strict=True), start=1):
        on_progress(done / len(names), f"Copying {done}/{len(names)}")
        if number < 0:
            continue
        image = read(name)
        yield _Copy(image, image)
        for at in range(number):
            change = draw_change(image, at, settings, seed)
            yield _Copy(image, changed(image, change, f"{name}-copy-{at + 1:02d}"), change)


def _exists(output: Path, work: _Copy) -> bool:
    return annotation_path(output, work.made.name).is_file()


def _encoded(folder: Path, work: _Copy, *, quality: int) -> bytes | None:
    """The picture of a copy as JPEG; None where it is that of the image.

    Raises:
        PictureError: the picture is damaged.
    """
    if work.change is None:
        return None
    with opened(folder / PICTURES / work.source.picture) as file:
        picture = np.asarray(file.convert("RGB"))
    held = BytesIO()
    Image.fromarray(changed_picture(picture, work.change)).save(held, "JPEG", quality=quality, subsampling=0)
    return held.getvalue()


def _write(
    work: _Copy, job: Future[bytes | None] | None, folder: Path, output: Path, staging: Path, report: Report
) -> int:
    """Write an image, its XML file last. Returns how many are there now."""
    if job is None:
        return 1
    try:
        content = job.result()
    except PictureError as error:
        report.add(Finding.REFUSED, work.source.name, f"{error}; it is not copied", alike=work.source.name)
        return 0
    target = output / PICTURES / work.made.picture
    if content is None:
        link_or_copy(folder / PICTURES / work.source.picture, target)
    else:
        move_in(staging, target, content)
    move_in(staging, annotation_path(output, work.made.name), as_xml(work.made))
    return 1

"""Objects cut out of images: segmentation, quality checks, and the library of all cut-outs of a dataset.

An object is cut out by its outline if it has one. Otherwise GrabCut (Rother, Kolmogorov and Blake 2004) separates it
from the surroundings of its box. GrabCut often fails, so every cut-out must pass all checks of `QUALITY`; rejections
are counted by reason.

The library holds a picture with opacity for each cut-out and a JSON file for each image.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import BytesIO
from math import hypot, sqrt
from pathlib import Path
from statistics import median
from typing import Final

import cv2
import numpy as np
from PIL import Image
from scipy import ndimage

from pavetwin.arrays import BoolArray, Float64Array, UInt8Array
from pavetwin.labels.boxes import PixelBox, area, of_mask, within
from pavetwin.labels.classes import CAR, PERSON
from pavetwin.labels.common_form import AnnotatedImage, filled, image_names, read_images
from pavetwin.labels.voc import PICTURES
from pavetwin.training.datasets.pictures import PictureError, opened
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.resuming import OnStage, made_ahead, move_in

SIZES_M: Final = {CAR.name: (4.5, 1.8), PERSON.name: (0.5, 0.35)}
"""Length and width seen from above, of a usual car and of an upright person (shoulders and depth): our assumption, for
images whose ground resolution is not known."""

PLAUSIBLE_M: Final = {CAR.name: ((3.0, 20.0), (1.3, 3.6)), PERSON.name: ((0.3, 1.4), (0.2, 1.0))}
"""Least and greatest length and width; an arm, a bag and a lean towards the border make people longer."""

IMPLAUSIBLE: Final = "it has not the size of its class on the ground"

LEAST_PX: Final = {CAR.name: 12, PERSON.name: 8}  # Least width of a cut-out by class
LEAST_VISIBLE: Final = 0.97  # Least visible fraction of an object, if its source states one, as captures do
MARGIN: Final = 0.4  # Surroundings of a box that GrabCut sees, share of its longer side

_WORKING_PX: Final = (96, 160)
"""Boxes are enlarged or shrunk to between these for GrabCut: its colour models need pixels, and many take long."""

MOST_OF_IMAGE: Final = 12  # Cut-outs of one image: more objects of one place and light add little

_RING_PX: Final = 2

OfBox = Callable[["_Mask"], bool]


@dataclass(frozen=True, slots=True)
class CutOut:
    """One object, cut out."""

    name: str
    """Name of its image, and its number there."""
    category: str
    pixels: UInt8Array
    """(height, width, 4) red, green, blue and opacity, in the pixels of its image."""
    length_px: float
    """Longer side of the smallest rotated rectangle around it."""
    width_px: float
    angle_deg: float
    """Direction of its length from the image's columns, clockwise, −90 … 90."""
    surroundings: tuple[float, float, float]
    """Mean red, green and blue around it."""
    gsd_mm: float | None
    """Ground resolution of its image; None if unknown."""


@dataclass(frozen=True, slots=True)
class _Mask:
    """Measures of a mask's quality."""

    category: str
    is_exact: bool
    """True for an outline that the source provides."""
    box_share: float
    """Filled share of the label's box."""
    extent: float
    """Side of the mask's box over that of the label's box; the smaller ratio of both sides."""
    solidity: float
    """Filled share of its convex hull."""
    fullness: float
    """Filled share of its smallest rotated rectangle."""
    main_part: float
    """Share of its largest part."""
    difference: float
    """In CIE L*a*b* between both sides of its border."""
    length_px: float
    width_px: float


QUALITY: Final[tuple[tuple[str, OfBox], ...]] = (
    ("it is too small", lambda mask: mask.width_px >= LEAST_PX[mask.category]),
    ("it is in several parts", lambda mask: mask.main_part >= 0.9),
    ("it does not reach the sides of its box", lambda mask: mask.extent >= 0.82),
    ("it fills its box too little or wholly", lambda mask: mask.is_exact or 0.3 <= mask.box_share <= 0.97),
    (
        "its border is ragged",
        lambda mask: mask.is_exact or mask.solidity >= (0.9 if mask.category == CAR.name else 0.8),
    ),
    ("it has not the shape of a vehicle", lambda mask: mask.category != CAR.name or _is_like_a_car(mask)),
    ("it differs too little from what surrounds it", lambda mask: mask.difference >= 8.0),
)
"""Reason for rejection, and the check that a cut-out must pass. The limits were chosen by inspecting cut-outs."""


def _is_like_a_car(mask: _Mask) -> bool:
    return mask.fullness >= 0.78 and 1.5 <= mask.length_px / mask.width_px <= 4.5


def cut_outs(
    image: AnnotatedImage, picture: UInt8Array, on_rejected: Callable[[str], None] = lambda _reason: None
) -> Iterator[CutOut]:
    """The good cut-outs of an image's people and vehicles, up to `MOST_OF_IMAGE`.

    Args:
        picture: (height, width, 3)
        on_rejected: called with the reason for each rejected object.
    """
    wanted = [at for at, each in enumerate(image.annotations) if each.ignored is None and each.category in SIZES_M]
    order = np.random.default_rng(len(wanted)).permutation(len(wanted))
    good = 0
    for number in (wanted[at] for at in order.tolist()):
        if good == MOST_OF_IMAGE:
            return
        found = _cut_out(image, number, picture)
        if isinstance(found, CutOut):
            good += 1
            yield found
        else:
            on_rejected(found)


def _cut_out(image: AnnotatedImage, number: int, picture: UInt8Array) -> CutOut | str:
    """A cut-out, or why there is none."""
    each = image.annotations[number]
    assert each.category is not None
    left, top, right, bottom = each.box
    width, height = image.size_px
    if left < 2 or top < 2 or right > width - 2 or bottom > height - 2:
        return "it touches the border of its image"
    if min(right - left, bottom - top) < LEAST_PX[each.category]:
        return "it is too small"
    others = (other.box for other in image.annotations if other is not each)
    if any(_common(each.box, other) > 0.02 * area(each.box) for other in others):
        return "another object is before or behind it"
    if float(each.attributes.get("visible_fraction", 1.0)) < LEAST_VISIBLE:
        return "a part of it is hidden"
    margin = round(MARGIN * max(right - left, bottom - top)) + 4
    window = (max(left - margin, 0), max(top - margin, 0), min(right + margin, width), min(bottom + margin, height))
    part = picture[window[1] : window[3], window[0] : window[2]]
    box = (left - window[0], top - window[1], right - window[0], bottom - window[1])
    if each.outline is not None:
        mask = filled(each, image.size_px)[window[1] : window[3], window[0] : window[2]].copy()
    else:
        mask = segmented(part, box)
    judged, angle_deg = _judged(each.category, part, mask, box, is_exact=each.outline is not None)
    for reason, is_good in QUALITY:
        if not is_good(judged):
            return reason
    if image.gsd_mm is not None and not is_plausible(each.category, judged.length_px, judged.width_px, image.gsd_mm):
        return IMPLAUSIBLE
    held = of_mask(mask)
    assert held is not None, "it was judged good"
    place = np.s_[max(held[1] - 2, 0) : held[3] + 2, max(held[0] - 2, 0) : held[2] + 2]
    around = ndimage.binary_dilation(mask, iterations=8) & ~ndimage.binary_dilation(mask, iterations=3)
    red, green, blue = part[around].mean(axis=0).tolist()
    return CutOut(
        name=f"{image.name}-{number:03d}",
        category=each.category,
        pixels=np.dstack([part[place], mask[place].astype(np.uint8) * 255]),
        length_px=judged.length_px,
        width_px=judged.width_px,
        angle_deg=angle_deg,
        surroundings=(red, green, blue),
        gsd_mm=image.gsd_mm,
    )


def usual_gsd_mm(category: str, length_px: float, width_px: float) -> float:
    """Millimetres a pixel covers where an object has the usual size of its class."""
    length_m, width_m = SIZES_M[category]
    return 1000 * sqrt(length_m * width_m / (length_px * width_px))


def is_plausible(category: str, length_px: float, width_px: float, gsd_mm: float) -> bool:
    """Return whether an object's size on the ground is plausible for its class."""
    sides_m = (length_px * gsd_mm / 1000, width_px * gsd_mm / 1000)
    return all(low <= side <= high for side, (low, high) in zip(sides_m, PLAUSIBLE_M[category], strict=True))


def _common(box: PixelBox, other: PixelBox) -> float:
    inside = within(box, other)
    return area(inside) if inside is not None else 0.0


def segmented(part: UInt8Array, box: PixelBox) -> BoolArray:
    """The mask of what stands in a box of a picture (height, width, 3), by GrabCut; the same for the same input."""
    left, top, right, bottom = box
    longer = max(right - left, bottom - top)
    factor = float(np.clip(longer, *_WORKING_PX)) / longer
    size = (round(part.shape[1] * factor), round(part.shape[0] * factor))
    seen = cv2.resize(part, size, interpolation=cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA)
    x, y = np.meshgrid(np.arange(size[0]) / factor, np.arange(size[1]) / factor)
    across = (x - (left + right) / 2) / ((right - left) / 2)
    down = (y - (top + bottom) / 2) / ((bottom - top) / 2)
    labels = np.full(seen.shape[:2], cv2.GC_BGD, dtype=np.uint8)
    labels[(np.abs(across) <= 1) & (np.abs(down) <= 1)] = cv2.GC_PR_BGD
    labels[across**2 + down**2 <= 1.0] = cv2.GC_PR_FGD
    labels[across**2 + down**2 <= 0.05] = cv2.GC_FGD
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    # The rectangle is not read where a mask is given.
    cv2.grabCut(np.ascontiguousarray(seen), labels, (0, 0, 1, 1), *models, 6, cv2.GC_INIT_WITH_MASK)
    mask = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD))
    mask = ndimage.binary_fill_holes(ndimage.binary_opening(mask, iterations=max(1, round(factor))))
    how = cv2.INTER_AREA if factor > 1 else cv2.INTER_LINEAR
    shrunk = cv2.resize(mask.astype(np.float32), part.shape[1::-1], interpolation=how)
    return np.array(shrunk > 0.5)


def _judged(category: str, part: UInt8Array, mask: BoolArray, box: PixelBox, *, is_exact: bool) -> tuple[_Mask, float]:
    """Quality measures of a mask, and the angle of its length [deg]. The mask keeps its largest part only."""
    parts, count = ndimage.label(mask, structure=np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    if not count or sizes.max() < 20:
        return _Mask(category, is_exact, 0, 0, 0, 0, 0, 0, 0, 0), 0.0
    whole = float(mask.sum())
    mask &= parts == int(sizes.argmax()) + 1
    points = np.argwhere(mask)[:, ::-1]
    corners = np.concatenate([points + np.array(to) for to in ((0, 0), (1, 0), (0, 1), (1, 1))]).astype(np.float32)
    hull = cv2.convexHull(corners)
    _, sides, _ = rectangle = cv2.minAreaRect(corners)
    first, second, third = cv2.boxPoints(rectangle)[:3]
    along = max((second - first, third - second), key=lambda side: hypot(*side))
    pixels = float(mask.sum())
    (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
    judged = _Mask(
        category=category,
        is_exact=is_exact,
        box_share=pixels / area(box),
        extent=float(min((right - left) / (box[2] - box[0]), (bottom - top) / (box[3] - box[1]))),
        solidity=pixels / float(cv2.contourArea(hull)),
        fullness=pixels / (sides[0] * sides[1]),
        main_part=pixels / whole,
        difference=_difference(part, mask),
        length_px=float(max(sides)),
        width_px=float(min(sides)),
    )
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    return judged, (angle + 90) % 180 - 90


def _difference(part: UInt8Array, mask: BoolArray) -> float:
    """Mean distance in L*a*b* of the pixels inside the border to the mean of those next to them outside."""
    lab: Float64Array = cv2.cvtColor(part.astype(np.float32) / 255, cv2.COLOR_RGB2LAB).astype(np.float64)
    inside = mask & ~ndimage.binary_erosion(mask, iterations=_RING_PX)
    outside = ndimage.binary_dilation(mask, iterations=_RING_PX + 1) & ~ndimage.binary_dilation(mask)
    if not inside.any() or not outside.any():
        return 0.0
    near = np.stack([_blurred(lab[..., at] * outside, outside) for at in range(3)], axis=-1)
    return float(np.linalg.norm(lab[inside] - near[inside], axis=1).mean())


def _blurred(values: Float64Array, where: BoolArray) -> Float64Array:
    """The mean of values where they count, near each pixel."""
    weights = ndimage.gaussian_filter(where.astype(np.float64), 2 * _RING_PX)
    means: Float64Array = ndimage.gaussian_filter(values, 2 * _RING_PX) / np.maximum(weights, 1e-9)
    return means


def ground_resolution(image: AnnotatedImage, found: list[CutOut]) -> float | None:
    """Millimetres a pixel covers: as stated, else by the vehicles that are cut out of it, else by its people."""
    if image.gsd_mm is not None:
        return image.gsd_mm
    for category in (CAR.name, PERSON.name):
        estimates = [
            usual_gsd_mm(category, each.length_px, each.width_px) for each in found if each.category == category
        ]
        if estimates:
            return float(median(estimates))
    return None


CUT_OUTS: Final = "CutOuts"
"""Folder of the cut-outs in a dataset."""


@dataclass(frozen=True, slots=True)
class StoredCutOut:
    """A cut-out without its pixels."""

    name: str
    category: str
    length_px: float
    width_px: float
    angle_deg: float
    surroundings: tuple[float, float, float]
    gsd_mm: float | None
    """Ground resolution as the source states it; in a library, else that of its scene."""

    @classmethod
    def of(cls, cut_out: CutOut) -> "StoredCutOut":
        return cls(**{key: getattr(cut_out, key) for key in cls.__dataclass_fields__})

    def loaded(self, folder: Path) -> CutOut:
        with opened(folder / f"{self.name}.png") as file:
            pixels = np.asarray(file.convert("RGBA"))
        return CutOut(pixels=pixels, **asdict(self))


def read_picture(folder: Path, image: AnnotatedImage) -> UInt8Array:
    """(height, width, 3) The picture of an image.

    Raises:
        PictureError: it is damaged or missing.
    """
    with opened(folder / PICTURES / image.picture) as file:
        return np.asarray(file.convert("RGB"))


def cut_out_all(
    folder: Path, output: Path, staging: Path, sources: tuple[str, ...], report: Report, on_progress: OnStage
) -> list[tuple[str, StoredCutOut]]:
    """The good cut-outs of a dataset's images of these sources, each with its scene, in a folder of the output; those
    there are kept. All have a ground resolution.

    Args:
        staging: a folder for files that are not whole yet.
    """
    names = image_names(folder)

    def found() -> Iterator[AnnotatedImage]:
        for done, image in enumerate(read_images(folder), start=1):
            on_progress(done / len(names), f"Cutting out {done}/{len(names)}")
            if image.source in sources:
                yield image

    library: list[tuple[str, StoredCutOut]] = []
    for image, job in made_ahead(
        found(), partial(_cut, folder), exists=lambda image: (output / CUT_OUTS / f"{image.name}.json").is_file()
    ):
        path = output / CUT_OUTS / f"{image.name}.json"
        if job is not None:
            try:
                made, reasons = job.result()
            except PictureError as error:
                report.add(Finding.REFUSED, image.name, f"{error}; nothing is cut out of it")
                continue
            for each in made:
                held = BytesIO()
                Image.fromarray(each.pixels, "RGBA").save(held, "PNG")
                move_in(staging, output / CUT_OUTS / f"{each.name}.png", held.getvalue())
            records = [asdict(StoredCutOut.of(each)) for each in made]
            move_in(staging, path, json.dumps({"cut_outs": records, "not": reasons}, indent=1).encode())
        content = json.loads(path.read_text(encoding="utf-8"))
        library += [
            (image.group, StoredCutOut(**{**each, "surroundings": tuple(each["surroundings"])}))
            for each in content["cut_outs"]
        ]
        for reason, count in content["not"].items():
            for _ in range(count):
                report.add(Finding.DROPPED, image.name, f"an object is not cut out: {reason}", alike=reason)
    return _resolved(library, report)


def _resolved(found: list[tuple[str, StoredCutOut]], report: Report) -> list[tuple[str, StoredCutOut]]:
    """Cut-outs, each with its scene, with a ground resolution: as stated, else the median by which the vehicles of
    their scene have their usual size, or where it has none, its people."""
    estimates: dict[tuple[str, str], list[float]] = defaultdict(list)
    for scene, each in found:
        estimates[scene, each.category].append(usual_gsd_mm(each.category, each.length_px, each.width_px))
    library = []
    for scene, each in found:
        gsd_mm = each.gsd_mm
        if gsd_mm is None:
            gsd_mm = round(median(estimates.get((scene, CAR.name)) or estimates[scene, PERSON.name]), 3)
        if is_plausible(each.category, each.length_px, each.width_px, gsd_mm):
            library.append((scene, replace(each, gsd_mm=gsd_mm)))
        else:
            report.add(Finding.DROPPED, each.name, f"an object is not cut out: {IMPLAUSIBLE}", alike=IMPLAUSIBLE)
    return library


def _cut(folder: Path, image: AnnotatedImage) -> tuple[list[CutOut], Counter[str]]:
    """The cut-outs of an image; and why other objects have none."""
    reasons: Counter[str] = Counter()
    made = list(cut_outs(image, read_picture(folder, image), lambda reason: reasons.update([reason])))
    return made, reasons

"""All objects cut out of a dataset's images, stored: a picture with opacity for each, and a file for each image."""

import json
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.labels.classes import CAR, PERSON
from pavetwin.training.datasets.ahead import made_ahead
from pavetwin.training.datasets.annotated import AnnotatedImage
from pavetwin.training.datasets.common_form import PICTURES, image_names, read_images
from pavetwin.training.datasets.cutouts import IMPLAUSIBLE, CutOut, cut_outs, is_plausible, usual_gsd_mm
from pavetwin.training.datasets.importing import move_in
from pavetwin.training.datasets.merging import OnMerge
from pavetwin.training.datasets.pictures import PictureError, opened
from pavetwin.training.datasets.report import Finding, Report

CUT_OUTS: Final = "CutOuts"
"""Folder of the objects, beside the images."""


@dataclass(frozen=True, slots=True)
class StoredCutOut:
    """What is known of a cut-out without its pixels."""

    name: str
    category: str
    length_px: float
    width_px: float
    angle_deg: float
    surroundings: tuple[float, float, float]
    gsd_mm: float | None
    """As its source states it; in a library that of its scene, where its source does not."""

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
    folder: Path, output: Path, staging: Path, sources: tuple[str, ...], report: Report, on_progress: OnMerge
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

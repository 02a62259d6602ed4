"""Several datasets merged into one: repeated photographs are kept once, and scenes are kept apart.

1. Of pictures that are the same (`duplicates.SAME`, or the same file) the first is kept, in the order in which the
   datasets are given and then by name. The others are dropped, with their labels.
2. Pictures that show one place, those that are dropped too, as a whole (`duplicates.ALIKE`) or where they overlap
   (`overlaps`), become one scene with all of their scenes' images, so that a split cannot put them on both sides.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.errors import PaveTwinError
from pavetwin.files import link_or_copy, staging_folder, working_in
from pavetwin.labels.common_form import (
    DESCRIPTION,
    annotation_path,
    as_xml,
    image_names,
    read_description,
    read_image,
    write_description,
)
from pavetwin.labels.voc import ANNOTATIONS, PICTURES
from pavetwin.training.datasets.duplicates import SAME, Features, Signature, alike, candidates, overlap, signature
from pavetwin.training.datasets.importing import ImportSummary
from pavetwin.training.datasets.pictures import PictureError
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.resuming import THREADS, OnStage, check_same, described, move_in

CHUNK: Final = 64  # Pictures that are read before the first of them is looked at


ImagePlace = tuple[Path, str]
"""A dataset's folder and the name of one of its images."""


class _Scenes:
    """Disjoint sets of scenes that show one place; the first name represents a set."""

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}

    def of(self, scene: str) -> str:
        while (above := self._parent.get(scene, scene)) != scene:
            scene = above
        return scene

    def join(self, one: str, other: str) -> bool:
        """Join two scenes. Returns whether they were separate."""
        first, second = sorted((self.of(one), self.of(other)))
        if first == second:
            return False
        self._parent[second] = first
        return True


def merge(folders: Sequence[Path], output: Path, *, on_progress: OnStage = lambda _share, _what: None) -> ImportSummary:
    """Merge datasets into a new one, unless that was done before; pictures are linked where the file system can.

    Raises:
        PaveTwinError: a folder holds no finished dataset, one is named twice, or the output cannot be written.
    """
    expected = {"made_by": "merge", "datasets": [described(folder) for folder in folders]}
    if len({folder.resolve() for folder in (*folders, output)}) <= len(folders):
        raise PaveTwinError("The datasets to merge and the new one must be different folders.")
    report = Report()
    with working_in(output):
        check_same(output, expected)
        if (finished := _finished(output)) is not None:
            return finished
        write_description(output, {**expected, "complete": False})
        places = [(folder, name) for folder in folders for name in image_names(folder)]
        kept, scenes = _sorted_out(places, report, on_progress)
        images = _write(kept, scenes, output, report, on_progress)
        report.save(output / REPORT)
        write_description(output, {**expected, "complete": True, "images": images})
    return ImportSummary(output, images, report)


def _finished(output: Path) -> ImportSummary | None:
    """Result of an earlier, complete call; comparing all pictures again takes minutes."""
    description = read_description(output) if (output / DESCRIPTION).is_file() else {}
    report = Report.load(output / REPORT)
    names = image_names(output)
    if not description.get("complete") or report is None or len(names) != description["images"]:
        return None
    return ImportSummary(output, len(names), report)


def _sorted_out(places: list[ImagePlace], report: Report, on_progress: OnStage) -> tuple[list[ImagePlace], _Scenes]:
    """The images that are kept, and their scenes."""
    scenes, hashes = _Scenes(), dict[str, tuple[ImagePlace, str]]()
    readable: list[ImagePlace] = []
    groups: list[str] = []
    rows: list[Float32Array] = []
    described: list[Features] = []
    for done, (place, found) in enumerate(_signatures(places), start=1):
        on_progress(done / len(places), f"Comparing {done}/{len(places)}")
        folder, name = place
        if isinstance(found, PictureError):
            report.add(Finding.REFUSED, _label(place), f"{found}; the image is left out")
            continue
        scene = read_image(annotation_path(folder, name)).group
        if (first := hashes.setdefault(found.sha256, (place, scene)))[0] != place:
            report.add(Finding.DROPPED, _label(place), f"the same picture as {_label(first[0])}")
            scenes.join(first[1], scene)
            continue
        readable.append(place)
        rows.append(found.thumbnail)
        described.append(found.features)
        groups.append(scene)
    dropped: set[int] = set()
    for one, other, correlation in alike(np.array(rows, dtype=np.float32)) if rows else ():
        are_two = scenes.join(groups[one], groups[other])
        if correlation >= SAME and not {one, other} & dropped:
            dropped.add(other)
            report.add(Finding.DROPPED, _label(readable[other]), f"the same picture as {_label(readable[one])}")
        elif are_two:
            words = f"shows the same place as {_label(readable[one])}; their scenes are one"
            report.add(Finding.NOTE, _label(readable[other]), words)
    pairs = list(candidates(described))
    for done, (one, other) in enumerate(pairs, start=1):
        on_progress(done / len(pairs), f"Comparing places {done}/{len(pairs)}")
        if scenes.of(groups[one]) == scenes.of(groups[other]):
            continue
        if overlap(described[one], described[other]):
            scenes.join(groups[one], groups[other])
            words = f"overlaps {_label(readable[one])}; their scenes are one"
            report.add(Finding.NOTE, _label(readable[other]), words)
    return [place for at, place in enumerate(readable) if at not in dropped], scenes


def _signatures(places: list[ImagePlace]) -> Iterator[tuple[ImagePlace, Signature | PictureError]]:
    """Signature of each picture in order, or the error."""

    def of(place: ImagePlace) -> Signature | PictureError:
        folder, name = place
        try:
            return signature(folder / PICTURES / read_image(annotation_path(folder, name)).picture)
        except PictureError as error:
            return error

    with ThreadPoolExecutor(THREADS) as threads:
        for start in range(0, len(places), CHUNK):
            part = places[start : start + CHUNK]
            yield from zip(part, threads.map(of, part), strict=True)


def _write(kept: list[ImagePlace], scenes: _Scenes, output: Path, report: Report, on_progress: OnStage) -> int:
    for inner in (PICTURES, ANNOTATIONS):
        (output / inner).mkdir(exist_ok=True)
    taken: dict[str, ImagePlace] = {}
    with staging_folder(output / "staging") as staging:
        for done, (folder, name) in enumerate(kept, start=1):
            on_progress(done / len(kept), f"Writing {done}/{len(kept)}")
            if (other := taken.setdefault(name.casefold(), (folder, name))) != (folder, name):
                words = f"two images of one name, this and {_label(other)}; the second is left out"
                report.add(Finding.REFUSED, _label((folder, name)), words)
                continue
            if annotation_path(output, name).is_file():
                continue
            image = read_image(annotation_path(folder, name))
            link_or_copy(folder / PICTURES / image.picture, output / PICTURES / image.picture)
            move_in(staging, annotation_path(output, name), as_xml(replace(image, group=scenes.of(image.group))))
    return len(taken)


def _label(place: ImagePlace) -> str:
    return f"{place[0].name}/{place[1]}"

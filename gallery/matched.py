"""Photographs with their ground resolution and subject, and how frames like them are taken, stored and judged."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from gallery.renderer import GalleryRenderer
from gallery.texture import SIDE_PX
from pavetwin.labels.boxes import FloatBox
from pavetwin.scene.view import View, look
from pavetwin.training.datasets.markings import marking_gsd_mm, painted_lines
from pavetwin.training.datasets.report import Report
from pavetwin.training.datasets.rules import outcome
from pavetwin.training.datasets.sources.base import DatasetSource
from pavetwin.world.model import Defect
from pavetwin.world.segments import direction_at

ENDINGS: Final = (".jpg", ".jpeg", ".png")
BLANK: Final = 0.01
"""Photographs with more of pure black than this were padded."""

KINDS: Final = {
    "Pothole": "pothole",
    "Crocodile Crack": "crocodile_crack",
    "Single Crack": "single_crack",
}
"""The town's defects by the class of a photograph's label; the first that a photograph has is its subject."""

HOVERING: Final = 4
"""Every so many frames is taken while hovering; the others while flying along the street at `SPEED_MPS`, as those of
datasets are. (Photographs show it: without motion their finest detail is told apart more easily.)"""
SPEED_MPS: Final = (2.0, 6.0)
STORED: Final = (75, 95)
"""Qualities at which pictures were stored one after the other, as JPEG with halved colours. The coefficients of all 40
photographs of RDD2022's China drone subset that were looked at are multiples of the table of quality 75, aligned with
the picture; the table of their files is that of 95."""
NARROW_PX: Final = 9
BESIDE_PX: Final = 16
SEEN: Final = 1.9
"""`darkness` of damage that can be seen without being pointed at, in frames that we looked at."""


@dataclass(frozen=True)
class Photograph:
    """A photograph, or a part of one, of at most `SIDE_PX` squared."""

    path: Path
    """Of the whole."""
    name: str
    picture: Image.Image
    gsd_m: float
    """Metres on the ground that a pixel shows, stated or from the width of painted lines."""
    kind: str | None
    """Of the damage that it is labelled with."""
    has_line: bool


Pair = tuple[Photograph, Image.Image]
"""With the frame that is like it."""


def metres(millimetres: float | None) -> float | None:
    """None stays None."""
    return None if millimetres is None else millimetres / 1000


def pictures_in(folder: Path) -> list[Path]:
    """All pictures of a folder, by name."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS)


def is_padded(picture: Image.Image) -> bool:
    """Whether a part of it is black."""
    return float((np.asarray(picture).max(axis=2) < 4).mean()) >= BLANK


def photographs(
    folder: Path, found: Sequence[Path], *, source: DatasetSource | None, gsd_m: float | None, line_m: float
) -> Iterator[Photograph]:
    """Those whose ground resolution is known. Larger ones are cut into parts around their labels.

    Args:
        folder: of the labels, too.
        found: the pictures to take.
        source: how labels are read; None without labels.
        gsd_m: of all of them; None where the lines in each tell it.
        line_m: width of a painted line.
    """
    labels = {} if source is None else {each.picture: each.objects for each in source.labels.images(folder, Report())}
    for path in found:
        whole = Image.open(path).convert("RGB")
        if is_padded(whole):
            continue
        resolution = gsd_m or metres(marking_gsd_mm(np.asarray(whole), line_m=line_m))
        if resolution is None:
            continue
        boxes = [(_kind(source, each.label), each.box) for each in labels.get(path, ())] if source else []
        for number, corner in enumerate(_corners(whole.size, [box for _, box in boxes])):
            part = whole.crop((*corner, corner[0] + SIDE_PX, corner[1] + SIDE_PX))
            seen = {kind for kind, box in boxes if _is_within(box, corner)}
            kind = next((each for each in KINDS.values() if each in seen), None)
            yield Photograph(
                path, f"{path.stem}-{number}", part, resolution, kind, bool(painted_lines(np.asarray(part)))
            )


def _kind(source: DatasetSource, label: str) -> str | None:
    return KINDS.get(outcome(source.classes, label) or "")


def _corners(size_px: tuple[int, int], boxes: Sequence[FloatBox]) -> list[tuple[int, int]]:
    """Upper left corners of parts around the middles of boxes, at least half a part from each other."""
    room = size_px[0] - SIDE_PX, size_px[1] - SIDE_PX
    if max(room) <= 0:
        return [(0, 0)]
    corners: list[tuple[int, int]] = []
    for left, top, right, bottom in boxes:
        middle = ((left + right) / 2, (top + bottom) / 2)
        x, y = (round(min(max(at - SIDE_PX / 2, 0), most)) for at, most in zip(middle, room, strict=True))
        if all(max(abs(x - u), abs(y - v)) >= SIDE_PX / 2 for u, v in corners):
            corners.append((x, y))
    return corners


def _is_within(box: FloatBox, corner: tuple[int, int]) -> bool:
    x, y = (box[0] + box[2]) / 2 - corner[0], (box[1] + box[3]) / 2 - corner[1]
    return 0 <= x < SIDE_PX and 0 <= y < SIDE_PX


def flight_view(
    renderer: GalleryRenderer, defect: Defect, place_m: tuple[float, float], gsd_m: float, index: int, side_px: int
) -> View:
    """A drone's camera straight over a place, its image upright along a defect's street, which the drone flies along.

    Args:
        renderer: of the town.
        defect: whose street it is.
        place_m: easting and northing below the camera.
        gsd_m: metres on the ground that a pixel shows.
        index: every `HOVERING`-th hovers; others have other directions and speeds.
        side_px: of the image, a part of the camera's.
    """
    focal_px = renderer.camera.image_px[1] / (2 * math.tan(renderer.camera.fov_rad / 2))
    line = renderer.world.segment(defect.segment).centre_line
    dx, dy = direction_at(line, line.project(defect.centre))
    yaw = math.atan2(dy, dx) + 0.15 * math.sin(7 * index)
    slow, fast = SPEED_MPS
    speed = slow + (fast - slow) * (index * 0.414214 % 1) if index % HOVERING else 0.0
    return look(
        (*place_m, gsd_m * focal_px),
        yaw_rad=yaw,
        pitch_rad=-math.pi / 2,
        size_px=(side_px, side_px),
        vertical_fov_rad=2 * math.atan(side_px / 2 / focal_px),
        velocity_mps=(speed * math.cos(yaw), speed * math.sin(yaw), 0.0),
    )


def darkness(frame: Image.Image, outline_px: npt.NDArray[np.float64]) -> float:
    """How much darker narrow dark features are within an outline (n, 2) than beside it; 1 where they are alike.

    What is narrow and dark is what closing the lightness over `NARROW_PX` fills (a black top-hat). Damage lies in its
    outline and pavement beside it, up to `BESIDE_PX` away.
    """
    lightness = cv2.GaussianBlur(np.asarray(frame.convert("L")), (0, 0), 0.7)
    narrow = cv2.morphologyEx(lightness, cv2.MORPH_BLACKHAT, np.ones((NARROW_PX, NARROW_PX), np.uint8))
    inside = cv2.fillPoly(np.zeros_like(lightness), [np.round(outline_px).astype(np.int32)], 1)
    inside = cv2.dilate(inside, np.ones((3, 3), np.uint8))
    near, far = (cv2.dilate(inside, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) for reach in (3, BESIDE_PX))
    if not inside.any() or (far == near).all():
        return 0.0
    return float(narrow[inside > 0].mean() / max(narrow[far > near].mean(), 0.5))


def stored(picture: Image.Image) -> Image.Image:
    """A picture after it was stored as the photographs were."""
    for quality in STORED:
        file = BytesIO()
        picture.save(file, "JPEG", quality=quality, subsampling="4:2:0")
        picture = Image.open(file).convert("RGB")
    return picture

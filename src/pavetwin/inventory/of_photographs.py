"""Detections in a folder of photographs, each placed by its EXIF and the XMP tags of DJI."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from shapely import Polygon

from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.reading import Reading, counted_remarks
from pavetwin.labels.boxes import corners, ends_at_border
from pavetwin.labels.outlines import hull
from pavetwin.perception.images import SourceImage, source_images
from pavetwin.perception.measuring import check_size, with_sizes
from pavetwin.perception.photograph import PhotographPose
from pavetwin.sensing.detector import ImageDetector
from pavetwin.world.georeference import (
    ELLIPSOID,
    NORTHERNMOST_DEG,
    SOUTHERNMOST_DEG,
    GeoReference,
    anchored,
    from_wgs84,
)

HIGHEST_M: Final = 150.0
"""Height above the ground from which a stated height counts as one above the sea, since most countries allow 120 m; our
assumption."""

FARTHEST_M: Final = 20_000.0
"""Distance from the median of all positions beyond which a position counts as damaged; our assumption."""

_AS_ABOVE_SEA: Final = (
    "the same height above the ground as above the sea, so that places and sizes are wrong unless the ground lies at "
    "sea level; else give the height by `height_m`"
)


def photographed(
    detector: ImageDetector,
    folder: Path,
    *,
    gsd_mm: float | None = None,
    height_m: float | None = None,
    position_error_m: float | None = None,
    output: Path | None = None,
    report: Callable[[float, str], None] = lambda share, what: None,  # noqa: ARG005
) -> Reading:
    """Search every photograph of a folder, except images that an inventory wrote into it.

    Args:
        gsd_mm: ground resolution of all photographs, for sizes; takes precedence over their tags.
        height_m: height of all photographs above the ground, likewise.
        position_error_m: standard deviation of all positions, likewise; 0 unless a photograph states one.
        output: folder of the results; images in it are skipped.
        report: called with the share done and a message.

    Raises:
        PaveTwinError: the folder holds no readable image, or a value is out of its bounds.
    """
    for name, value in (("gsd_mm", gsd_mm), ("height_m", height_m)):
        if value is not None:
            check_size(name, value)
    if position_error_m is not None:
        check_size("position_error_m", position_error_m, may_be_zero=True)
    taken: list[_Taken] = []
    unreadable: list[str] = []
    images = 0
    for image in source_images(folder, output=output):
        report(image.share, f"Searching photograph {images + 1}")
        try:
            pixels, pose = image.read()
        except PaveTwinError as error:
            unreadable.append(str(error))
            continue
        images += 1
        known = pose or PhotographPose((pixels.shape[1], pixels.shape[0]))
        if height_m is not None:
            known = replace(known, height_m=height_m)
        reason = _why_without_place(known, has_scale=gsd_mm is not None)
        (seen,) = detector.detect([pixels])
        taken.append(_Taken(image, known, seen, reason))
    if not images:
        raise PaveTwinError(unreadable[0])
    taken = _without_far(taken)
    places = [each.pose.lonlat for each in taken if each.has_place and each.pose.lonlat is not None]
    frame = anchored(places[0][1], places[0][0]) if places else None
    found: list[Detections] = []
    missing: dict[str, list[str]] = defaultdict(list)
    for image, known, seen, reason in taken:
        if reason:
            missing[reason].append(image.name)
        elif height_m is None and known.is_height_above_sea:
            missing[_AS_ABOVE_SEA].append(image.name)
        error_m = position_error_m if position_error_m is not None else known.position_error_m or 0.0
        where = None if reason else frame
        found.append(_on_ground(seen[seen.is_defect], image.name, known, where, gsd_mm, error_m))
    remarks = counted_remarks(missing, images)
    if unreadable:
        remarks += (f"Left out: {len(unreadable)} that cannot be read, such as this: {unreadable[0]}",)
    readers = {image.name: image.read for image, _, _, _ in taken}
    return Reading(Detections.concatenated(found), frame, images, remarks, readers=readers)


class _Taken(NamedTuple):
    """A searched photograph."""

    image: SourceImage
    pose: PhotographPose
    seen: Detections
    reason: str
    """Reason why its defects have no place on the ground; empty if they have one."""

    @property
    def has_place(self) -> bool:
        return not self.reason


def _without_far(taken: list[_Taken]) -> list[_Taken]:
    """The photographs, with a reason for those taken far from the others."""
    placed = [at for at, each in enumerate(taken) if each.has_place]
    if not placed:
        return taken
    lon, lat = np.array([taken[at].pose.lonlat for at in placed], dtype=np.float64).T
    lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0  # across the date line too
    middle = (np.full(len(placed), np.median(lon)), np.full(len(placed), np.median(lat)))
    _, _, away_m = ELLIPSOID.inv(lon, lat, *middle)
    far = {at for at, each_m in zip(placed, away_m, strict=True) if each_m > FARTHEST_M}
    reason = (
        f"taken more than {FARTHEST_M / 1000:g} km from the middle of all positions; its defects are given in pixels"
    )
    return [each._replace(reason=reason) if at in far else each for at, each in enumerate(taken)]


def _why_without_place(pose: PhotographPose, *, has_scale: bool) -> str:
    """What is missing for places on the ground; empty if nothing is."""
    sizes = "" if has_scale else ", sizes with `gsd_mm` only"
    if pose.lonlat is None:
        return f"no position; its defects are given in pixels{sizes if pose.gsd_mm(0, 0) is None else ''}"
    if not SOUTHERNMOST_DEG <= pose.lonlat[1] <= NORTHERNMOST_DEG:
        return "a position beyond 84° north or 80° south, where no map in metres is; its defects are given in pixels"
    if pose.is_turned:
        return (
            "stored turned (EXIF Orientation), so that its direction of view is not known; give it as the camera took "
            f"it; its defects are given in pixels{sizes}"
        )
    if pose.height_m is not None and pose.height_m <= 0:
        return f"a height above the ground of 0 m or less; give it by `height_m`{sizes}"
    if pose.height_m is None or pose.height_m > HIGHEST_M:
        return f"no height above the ground but one above the sea, or none; give it by `height_m`{sizes}"
    if pose.focal_px is None:
        return f"no focal length; its defects are given in pixels{sizes}"
    if pose.pitch_deg is None or pose.heading_deg is None:
        return f"no direction of view; its defects are given in pixels{sizes}"
    if not pose.is_nadir:
        return "the gimbal looks more than 30° from straight down; its defects are given in pixels"
    return ""


def _on_ground(
    found: Detections,
    image: str,
    pose: PhotographPose,
    frame: GeoReference | None,
    gsd_mm: float | None,
    error_m: float,
) -> Detections:
    """Detections of a photograph with sizes, and with footprints in a frame."""
    has_height, boxes = _has_height(pose), [found.box(row) for row in range(len(found))]
    scales = [
        gsd_mm or (pose.gsd_mm((left + right) / 2, (top + bottom) / 2) if has_height else None) or np.nan
        for left, top, right, bottom in boxes
    ]
    return (
        with_sizes(found, scales)
        .with_columns(
            image=[image] * len(found),
            footprint=[None if frame is None else _footprint(found, row, pose, frame) for row in range(len(found))],
            position_error_m=[error_m] * len(found),
            is_cut=[ends_at_border(box, pose.size_px) for box in boxes],
        )
        .without("mask")
    )


def _footprint(found: Detections, row: int, pose: PhotographPose, frame: GeoReference) -> Polygon | None:
    """The hull of a mask, or else the box, as a polygon of the frame."""
    mask = found.mask_pixels(row)
    outline = corners(found.box(row)) if mask is None or not mask[1].any() else hull(mask[1]) + mask[0][:2]
    lonlats = pose.lonlats(outline)
    return None if lonlats is None else Polygon(from_wgs84(frame, lonlats))


def _has_height(pose: PhotographPose) -> bool:
    return pose.height_m is not None and 0 < pose.height_m <= HIGHEST_M

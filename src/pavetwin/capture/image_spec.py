"""Specification of one image, and the geometry of poses that can meet it: defects in view, and ground resolution.

A pose is checked before its image is rendered. An image with a drawn ground resolution is a crop of the camera's whole
frame at its own resolution, as photographed datasets are cropped. The resolution decides the altitude: a pixel of a
camera with focal length f (pixels) covers h / f from a height of h.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array, IndexArray, StrArray
from pavetwin.config.mission import CEILING_M, LOWEST_M
from pavetwin.errors import PaveTwinError
from pavetwin.labels.classes import Category, category_of_defect
from pavetwin.scene.view import View
from pavetwin.uav.cameras import Camera, find_camera
from pavetwin.world.model import World

if TYPE_CHECKING:
    from pavetwin.capture.settings import CaptureSettings
    from pavetwin.scene.view import View


@dataclass(frozen=True)
class ImageSpec:
    """Requirements on one image, and the conditions in which it is taken."""

    platform: str
    index: int
    """Among its platform's images."""
    number: int
    """Unique in the dataset."""
    name: str
    """Name of its files."""
    split: str
    aims: tuple[Category, ...]
    """It must show one of these classes; empty: it must show no defect."""
    density: str
    altitude_m: float | None
    """Altitude of a flying platform; None if the ground resolution decides it."""
    gsd_mm: float | None
    """Ground resolution of an image that is a crop of the whole frame [mm a pixel]; None for whole images."""
    share: float
    """0 … 1, from which the platform derives its own choices."""


HORIZON_M = 45.0
"""Beyond it a defect is less than a pixel high for a camera on a car. The instance image still shows what is
visible."""

INNER = 0.8
"""The centre of a defect that an image aims at lies in this central share of its width and height."""

AIMED_WITHIN_M = 20.0
AIMED_PIXEL_M = 0.0133
"""A defect that an image aims at is within this distance of the camera, or a pixel covers no more than this there:
20 m at a focal length of 1500 pixels. Long lenses see farther than wide ones."""

AIMED_WIDTH_PX = 0.4  # Least width of the widest opening, seen from straight above: finer cracks are seldom visible

ROAD_SHARE = 0.2
"""Least share of road in an image without defects: a meadow is not an example of defect-free pavement."""

_BORDER = np.linspace(0.0, 1.0, 5)
_EVERYWHERE = (np.stack(np.meshgrid(np.arange(12), np.arange(12)), axis=-1).reshape(-1, 2) + 0.5) / 12


def footprint(view: View) -> Polygon:
    """The ground that a view may show, out to the horizon; convex, and never smaller than what is visible."""
    width, height = view.size_px
    edges = [(u, v) for u in _BORDER for v in _BORDER if u in (0.0, 1.0) or v in (0.0, 1.0)]
    pixels = np.array(edges) * (width, height)
    hits, rays = view.ground(pixels), view.rays(pixels)
    away = hits - view.position[:2]
    reach = np.hypot(away[:, 0], away[:, 1])
    flat = rays[:, :2] / np.maximum(1e-12, np.hypot(rays[:, 0], rays[:, 1]))[:, None]
    beyond = ~(reach <= HORIZON_M)
    hits[beyond] = view.position[:2] + flat[beyond] * HORIZON_M
    return Polygon(shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(hits))))


@dataclass(frozen=True)
class DefectIndex:
    """Spatial index of a world's defects, each with the split of its street."""

    world: World
    splits: Mapping[str, str]
    """Street → split."""

    @cached_property
    def outlines(self) -> shapely.STRtree:
        """(defects,) on the ground."""
        return shapely.STRtree([defect.polygon for defect in self.world.defects])

    @cached_property
    def split_of(self) -> StrArray:
        """(defects,)"""
        street_of = {segment.id: segment.street for segment in self.world.segments}
        return np.array([self.splits[street_of[defect.segment]] for defect in self.world.defects], dtype=np.str_)

    @cached_property
    def categories(self) -> IndexArray:
        """(defects,) numbers of their categories."""
        numbers = {kind: category_of_defect(kind).number for kind in {defect.kind for defect in self.world.defects}}
        return np.array([numbers[defect.kind] for defect in self.world.defects], dtype=np.intp)

    @cached_property
    def centres(self) -> Float64Array:
        """(defects, 3) on the ground, metres."""
        xy = [(defect.centre.x, defect.centre.y, 0.0) for defect in self.world.defects]
        return np.array(xy, dtype=np.float64).reshape(-1, 3)

    @cached_property
    def widths_m(self) -> Float64Array:
        """(defects,)"""
        return np.array([defect.width_m for defect in self.world.defects], dtype=np.float64)

    @cached_property
    def road(self) -> shapely.Geometry:
        """The world's carriageway, prepared."""
        road = self.world.carriageway
        shapely.prepare(road)
        return road

    def road_share(self, view: View) -> float:
        """Share of a view's pixels that show road, without occlusion."""
        hits = view.ground(_EVERYWHERE * view.size_px)
        return float(shapely.contains_xy(self.road, hits[np.isfinite(hits).all(axis=1)]).sum() / len(hits))

    def candidates(self, spec: ImageSpec) -> IndexArray:
        """The defects that a spec may aim at."""
        ours = self.split_of == spec.split
        return np.flatnonzero(ours & np.isin(self.categories, [category.number for category in spec.aims]))

    def may_show(self, view: View, spec: ImageSpec, covered: IndexArray) -> bool:
        """Return whether a view may meet a spec: no defect of another split, and one of its own that is wide enough to
        be seen; or no defect, and enough road.

        Args:
            covered: defects that cannot be seen from anywhere.
        """
        near = self.outlines.query(footprint(view), predicate="intersects")
        if not spec.aims:
            return not len(near) and self.road_share(view) >= ROAD_SHARE
        if not (self.split_of[near] == spec.split).all():
            return False
        aims = np.setdiff1d(np.intersect1d(near, self.candidates(spec)), covered)
        within = view.project(self.centres[aims]) / view.size_px
        away = np.linalg.norm(self.centres[aims] - view.position, axis=1)
        near_enough = away < max(AIMED_WITHIN_M, AIMED_PIXEL_M * view.focal_px)
        clear = near_enough & (self.widths_m[aims] * view.focal_px > AIMED_WIDTH_PX * away)
        with np.errstate(invalid="ignore"):
            return bool(((np.abs(within - 0.5) < INNER / 2).all(axis=1) & clear).any())


ROUNDING: Final = 1e-9
"""Share by which a number may be above a bound that was computed: 13.3 mm are taken where 13.299999999999999 are."""

EVEN: Final = 0.2
"""An image has one ground resolution where that of its corners differs from its middle's by no more than this share."""


def drawn_gsd_mm(bounds_mm: tuple[float, float], share: float) -> float:
    """Ground resolution at a share (0 … 1) of a log-uniform distribution over a range, millimetres a pixel.

    Log-uniform: as many images between 2 and 4 mm as between 4 and 8, since an object's size in pixels goes by ratios.
    """
    low, high = bounds_mm
    return float(low * (high / low) ** share)


def native_focal_px(camera: Camera) -> float:
    """Focal length in pixels of the camera's whole frame."""
    return float(camera.image_px[1] / (2 * np.tan(camera.fov_rad / 2)))


def image_gsd_mm(view: "View") -> float | None:
    """The ground resolution in an image's middle, millimetres a pixel; None where it varies much over the image, or
    where that shows no ground."""
    width, height = view.size_px
    places = np.array([[width / 2, height / 2], [0, 0], [width, 0], [0, height], [width, height]])
    middle, *corners = (1000 * view.ground_resolution_m(places)).tolist()
    return round(middle, 4) if all(abs(each - middle) <= EVEN * middle for each in corners) else None


def check_resolution(settings: "CaptureSettings") -> None:
    """Check that the camera reaches the ground resolutions of the settings, and has as many pixels as the crops.

    Raises:
        PaveTwinError: it does not.
    """
    if settings.gsd_mm is None:
        return
    camera = find_camera(settings.camera)
    (low, high), focal = settings.gsd_mm, native_focal_px(camera)
    finest, highest = 1000 * LOWEST_M / focal, 1000 * CEILING_M / focal
    coarsest = min(highest, 1000 * AIMED_PIXEL_M) if settings.empty < 1 else highest
    if low < finest or high > coarsest * (1 + ROUNDING):
        at_m, limit = (LOWEST_M, finest) if low < finest else (coarsest * focal / 1000, coarsest)
        why = "the lowest altitude" if low < finest else "the highest"
        if low >= finest and coarsest < highest:
            why += " at which defects are seen"
        raise PaveTwinError(
            f"`gsd_mm` {low:g} {high:g}: a pixel of the camera '{settings.camera}' covers {limit:.3g} mm from "
            f"{at_m:.3g} m, {why}; choose between {np.ceil(100 * finest) / 100:g} and "
            f"{np.floor(100 * coarsest) / 100:g} mm, or another `camera`."
        )
    if any(np.greater(settings.size_px, camera.image_px)):
        width, height = settings.size_px
        raise PaveTwinError(
            f"`size_px` {width}x{height}: more than the {'x'.join(map(str, camera.image_px))} pixels of the camera "
            f"'{settings.camera}', of which images with `gsd_mm` are crops."
        )

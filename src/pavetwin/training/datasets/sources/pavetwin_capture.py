"""PaveTwin's own captures: datasets made by `pavetwin capture`, from their COCO files."""

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import PurePosixPath
from typing import Any

from pavetwin.labels.common_form import class_names
from pavetwin.training.datasets.layouts import CocoLayout
from pavetwin.training.datasets.layouts.coco import CocoEntryError
from pavetwin.training.datasets.layouts.layout import RawObject
from pavetwin.training.datasets.sources.registry import SOURCES, DatasetSource

_KEPT = ("visible_fraction", "severity", "width_m", "area_m2")
"""Details of a rendered object that the common form keeps."""


class CaptureLayout(CocoLayout):
    """COCO files of a capture. Ignored objects state the reason. The split of a capture, by streets, is kept: no defect
    is in two of them. An image without labels is background, since a capture labels everything that it shows."""

    def is_picture(self, name: str) -> bool:
        return name.startswith("images/")

    def is_background(self, objects: Sequence[RawObject]) -> bool:
        return all(each.ignored is not None for each in objects)

    def details(self, labels: str, image: Mapping[str, Any]) -> dict[str, Any]:
        split = PurePosixPath(labels).stem.removeprefix("instances_")
        camera, light = _section(image, "camera"), _section(image, "light")
        kept = {key: str(camera[key]) for key in ("platform", "altitude_m") if key in camera}
        shadow = _shadow(camera, light)
        return {"attributes": {"split": split, **kept, **shadow}, "gsd_mm": camera.get("gsd_mm")}

    def ignored(self, content: Mapping[str, Any]) -> str | None:
        reason = content.get("ignored")
        return str(reason) if reason is not None else super().ignored(content)

    def object_details(self, content: Mapping[str, Any]) -> dict[str, str]:
        return {key: str(content[key]) for key in _KEPT if content.get(key) is not None}


def _section(image: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """The values of an image's camera or light; empty if it has none.

    Raises:
        CocoEntryError: it is not by name.
    """
    section = image.get(key)
    if section is not None and not isinstance(section, dict):
        raise CocoEntryError(f"'{key}' holds no values by name")
    return section or {}


def _shadow(camera: Mapping[str, Any], light: Mapping[str, Any]) -> dict[str, str]:
    """Direction of shadows in a nadir image, whose top is ahead of the camera."""
    keys = ("sun_azimuth_deg", "sun_elevation_deg", "cloud_cover")
    values: list[Any] = [camera.get("heading_deg"), *map(light.get, keys)]
    heading_deg, azimuth_deg, elevation_deg, clouds = values
    if not camera.get("gsd_mm") or None in (heading_deg, azimuth_deg, clouds):
        return {}
    if not all(isinstance(value, int | float) and isfinite(value) for value in values):
        raise CocoEntryError(f"heading_deg, {', '.join(keys)} are not all finite numbers")
    return {
        "shadow_deg": f"{(azimuth_deg + 180 - heading_deg) % 360:.1f}",
        "sun_elevation_deg": str(elevation_deg),
        "cloud_cover": str(clouds),
    }


SOURCES.add(
    "pavetwin",
    DatasetSource(
        title="PaveTwin's own captures",
        licence="of who captured them; worlds from OpenStreetMap: credit its contributors",
        labels=CaptureLayout(),
        classes={name: name for name in class_names()},
    ),
)

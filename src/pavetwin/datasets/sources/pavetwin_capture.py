"""PaveTwin's own captures: datasets made by `pavetwin capture`, from their COCO files."""

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from pavetwin.datasets.annotated import class_names
from pavetwin.datasets.layouts import CocoLayout
from pavetwin.datasets.layouts.base import RawObject
from pavetwin.datasets.sources.base import SOURCES, DatasetSource

_KEPT = ("visible_fraction", "severity", "width_m", "area_m2")
"""What the common form keeps of a rendered object."""


class CaptureLayout(CocoLayout):
    """Ignored objects say why. The capture's own split, by streets, is kept: no defect is in two of them. An image
    without labels is background: a capture labels everything that it shows."""

    def is_picture(self, name: str) -> bool:
        return name.startswith("images/")

    def is_background(self, objects: Sequence[RawObject]) -> bool:
        return all(each.ignored is not None for each in objects)

    def details(self, labels: str, image: Mapping[str, Any]) -> dict[str, Any]:
        split = PurePosixPath(labels).stem.removeprefix("instances_")
        camera = image.get("camera") or {}
        kept = {key: str(camera[key]) for key in ("platform", "altitude_m") if key in camera}
        shadow = _shadow(camera, image.get("light") or {})
        resolution = {"gsd_mm": camera["gsd_mm"]} if "gsd_mm" in camera else {}
        return {"attributes": {"split": split, **kept, **shadow}, **resolution}

    def ignored(self, content: Mapping[str, Any]) -> str | None:
        reason = content.get("ignored")
        return str(reason) if reason is not None else super().ignored(content)

    def object_details(self, content: Mapping[str, Any]) -> dict[str, str]:
        return {key: str(content[key]) for key in _KEPT if content.get(key) is not None}


def _shadow(camera: Mapping[str, Any], light: Mapping[str, Any]) -> dict[str, str]:
    """Where shadows fall in an image that looks straight down, whose top is what lies ahead of the camera."""
    heading_deg, azimuth_deg, clouds = camera.get("heading_deg"), light.get("sun_azimuth_deg"), light.get("cloud_cover")
    if not camera.get("gsd_mm") or None in (heading_deg, azimuth_deg, clouds):
        return {}
    return {
        "shadow_deg": f"{(float(azimuth_deg or 0) + 180 - float(heading_deg or 0)) % 360:.1f}",
        "sun_elevation_deg": str(light["sun_elevation_deg"]),
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

"""The camera database: image size, field of view, shutter. The user's own file extends it."""

from math import atan, degrees, radians, tan
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pavetwin.config.settings import Positive, Settings
from pavetwin.registry import Registry
from pavetwin.uav.entries import find_entry, parse_entries

Pixels = Annotated[int, Field(gt=0)]


class Development(Settings):
    """Development of a sensor's mosaic into a JPEG.

    It applies to images at the sensor's own resolution; downsampling to fewer pixels removes its effects.
    """

    lens_px: Annotated[float, Field(ge=0, le=0.7)] = 0.5
    """Standard deviation of the point spread of lens and photosite."""
    noise_reduction: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Differences of brightness to neighbours up to this many standard deviations of the sensor's noise are averaged
    out, fully where they are small."""
    colour_reach_px: Annotated[int, Field(ge=0, le=2)] = 0
    """Colours are means over this many pixels around."""
    sharpening: Annotated[float, Field(ge=0, le=3)] = 0.0
    """Share of the difference to a blurred image (Gaussian of one pixel) that is added."""


class Camera(Settings):
    """A pinhole camera that looks straight down, its image rows along the track."""

    title: str
    image_px: tuple[Pixels, Pixels]
    """Width (across track) and height (along track)."""
    vertical_fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    sensor_mm: tuple[Positive, Positive] | None = None
    focal_length_mm: Positive | None = None
    shutter: Literal["global", "rolling", "mechanical"] = "global"
    shortest_exposure_s: Positive | None = None
    shortest_interval_s: Positive | None = None
    """Between two pictures; None where it does not matter."""
    f_numbers: tuple[Positive, Positive] = (2.8, 2.8)
    """The widest aperture and the narrowest."""
    iso: tuple[Positive, Positive] = (100.0, 1600.0)
    """The lowest and the highest of still pictures."""
    readout_s: Annotated[float, Field(ge=0)] = 0.0
    """Rolling-shutter readout: from the exposure of the first row to that of the last."""
    development: Development | None = None
    """From its mosaic to its picture; None where that is not known."""
    source: str = ""

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        by_lens = self.sensor_mm is not None and self.focal_length_mm is not None
        if by_lens == (self.vertical_fov_deg is not None):
            raise ValueError("give either vertical_fov_deg or both sensor_mm and focal_length_mm")
        if self.f_numbers[0] > self.f_numbers[1] or self.iso[0] > self.iso[1]:
            raise ValueError("f_numbers and iso each name the lowest value, then the highest")
        return self

    @property
    def fov_rad(self) -> float:
        """Vertical field of view: 2·atan(sensor height / (2 f))."""
        if self.sensor_mm is not None and self.focal_length_mm is not None:
            return 2 * atan(self.sensor_mm[1] / (2 * self.focal_length_mm))
        assert self.vertical_fov_deg is not None
        return radians(self.vertical_fov_deg)

    @property
    def focal_mm(self) -> float:
        """Focal length; for a camera without a given sensor that of a 1/2.3" sensor, 4.55 mm high."""
        return self.focal_length_mm or 4.55 / (2 * tan(self.fov_rad / 2))

    @property
    def pitch_um(self) -> float | None:
        """Side of a photosite; None where the sensor's size is not known."""
        return None if self.sensor_mm is None else 1000 * self.sensor_mm[1] / self.image_px[1]

    @property
    def fov_deg(self) -> float:
        return degrees(self.fov_rad)

    def footprint_m(self, altitude_m: float) -> tuple[float, float]:
        """Ground covered (across the track, along the track), in metres."""
        along = 2 * altitude_m * tan(self.fov_rad / 2)
        return along * self.image_px[0] / self.image_px[1], along

    def ground_resolution_m(self, altitude_m: float) -> float:
        """Size of a pixel on level ground, in metres; constant over the image of a pinhole camera."""
        return self.footprint_m(altitude_m)[1] / self.image_px[1]


def parse_cameras(text: str, where: str) -> dict[str, Camera]:
    """The cameras of a YAML file's text, by name; `where` names the file in messages.

    Raises:
        PaveTwinError: it is not valid YAML, or does not hold cameras.
    """
    return parse_entries(Camera, "camera", text, where)


CAMERAS: Registry[Camera] = Registry(
    "camera", key="camera.model", group="pavetwin.cameras", home="pavetwin.uav.database"
)
"""The cameras of the database; a plugin adds one by `CAMERAS.add("name", Camera(...))`."""


def find_camera(model: str) -> Camera:
    """A camera by its name, or from a YAML file: `my.yaml` (its only camera) or `my.yaml:name`.

    Raises:
        PaveTwinError: no such camera or file.
    """
    return find_entry(CAMERAS, parse_cameras, model)

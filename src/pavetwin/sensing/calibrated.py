"""The sensor that finds what a detector would, without images: by a model that was fitted to rendered captures."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import cos, sin
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.perception.shipped import model_path
from pavetwin.seeds import Stream, child
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.draws import look_draw
from pavetwin.sensing.frame import Frame
from pavetwin.sensing.looks import Look, LookMeter
from pavetwin.sensing.registered import sensor
from pavetwin.sensing.sensor_model import SensorModel

_BLOCK: Final = 128
"""Frames whose false alarms are drawn together."""

_CORNERS: Final = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))


@sensor("calibrated")
class Calibrated(Sensor):
    """Finds defects with the chances of a file of `pavetwin sensor fit`, and reports as many false alarms.

    A look finds its defect by class, severity, size in pixels, visible fraction, place in the image, motion blur and
    light; what a defect keeps from look to look is drawn once for it (`pavetwin.sensing.sensor_model`). False alarms
    are a Poisson process on the ground of each image.
    """

    every_capture = True
    sees_confirmed = True
    is_fitted = True
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({"fitted": "", "model": ""})

    def __init__(self, settings: SensingSettings, seed: int, model: SensorModel | None = None) -> None:
        """Args:
            model: in place of the one that the option `fitted` names.

        Raises:
            PaveTwinError: none is named, its file is damaged, or it was fitted for another detector than the one that
                the option `model` names.
        """
        super().__init__(settings, seed)
        self.model = model or self._opened()
        self._meter = LookMeter(self.model.detector.image_px)
        self._looks: dict[int, dict[int, Look]] = {}
        """By defect and attempt."""
        self._expected_at: dict[tuple[float, tuple[int, int]], tuple[float, ...]] = {}

    def _opened(self) -> SensorModel:
        fitted, detector = str(self.options["fitted"]), str(self.options["model"])
        if not fitted:
            raise PaveTwinError(
                "The sensor 'calibrated' needs a file of `pavetwin sensor fit`: name it by `model`, as in sensor.json."
            )
        return _read(fitted, file_sha256(Path(fitted)), detector)

    def detect(self, frame: Frame) -> Sequence[Detection]:
        correlation = self.model.correlation
        found = []
        for sighting in frame.sightings:
            look, defect = self._meter.look(frame, sighting), sighting.defect.id
            self._looks.setdefault(defect, {})[sighting.attempt] = look
            if look_draw(self.seed, defect, sighting.attempt, correlation) < self.model.chance(look):
                found.append(Detection.of(sighting))
        return [*found, *self._false_alarms(frame)]

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array:
        from pavetwin.sensing.fit.draws import found_by_draws

        return found_by_draws(self.model, [[*self._looks.get(defect, {}).values()] for defect in defects])

    def _false_alarms(self, frame: Frame) -> list[Detection]:
        """Squares of the usual size, of each frame by its number and the seed alone."""
        kinds = list(self.model.false_alarms)
        block = _block(self.seed, frame.number // _BLOCK, self._expected(frame))
        drawn = block.get(frame.number % _BLOCK)
        if drawn is None:
            return []
        across_m, along_m = (frame.ground_resolution_m * side for side in frame.camera.image_px)
        pixel_m, (east, north) = self._meter.pixel_m(frame), frame.position
        cosine, sine = cos(frame.yaw_rad), sin(frame.yaw_rad)
        rings = []
        for number, left, top in drawn:
            side_m = pixel_m * self.model.false_alarms[kinds[number]].size_px
            right = (left - 0.5) * max(across_m - side_m, 0.0)
            ahead = (0.5 - top) * max(along_m - side_m, 0.0)
            half = min(side_m, across_m) / 2, min(side_m, along_m) / 2
            places = [(right + x * half[0], ahead + y * half[1]) for x, y in _CORNERS]
            rings.append([(east + y * cosine + x * sine, north + y * sine - x * cosine) for x, y in places])
        shapes: list[Polygon] = np.asarray(shapely.polygons(np.array(rings))).tolist()
        return [
            Detection(kinds[number], self.model.detector.confidence, shape, means_nothing=True)
            for (number, _, _), shape in zip(drawn, shapes, strict=True)
        ]

    def _expected(self, frame: Frame) -> tuple[float, ...]:
        """The expected number of each class in an image."""
        place = frame.altitude_m, frame.camera.image_px
        if place not in self._expected_at:
            own_m, (width, height) = frame.ground_resolution_m, frame.camera.image_px
            pixel_m, area_m2 = self._meter.pixel_m(frame), own_m**2 * width * height
            alarms = self.model.false_alarms.values()
            self._expected_at[place] = tuple(area_m2 * each.per_m2(pixel_m) for each in alarms)
        return self._expected_at[place]


@lru_cache(maxsize=256)
def _block(seed: int, number: int, expected: tuple[float, ...]) -> dict[int, list[tuple[int, float, float]]]:
    """The false alarms of `_BLOCK` frames: by frame, for each the number of its class, and its place in the image."""
    generator = child(seed, Stream.FALSE_ALARMS, number)
    counts = generator.poisson(expected, (_BLOCK, len(expected)))
    frames, kinds = (np.repeat(each.ravel(), counts.ravel()) for each in np.indices(counts.shape))
    found: dict[int, list[tuple[int, float, float]]] = {}
    for frame, kind, (left, top) in zip(
        frames.tolist(), kinds.tolist(), generator.random((len(frames), 2)), strict=True
    ):
        found.setdefault(frame, []).append((kind, left, top))
    return found


@lru_cache(maxsize=16)
def _read(fitted: str, content: str, detector: str) -> SensorModel:  # noqa: ARG001 - it is of the cache's key
    """A fitted sensor, read again only when its content has changed."""
    return SensorModel.read(Path(fitted), model_path(detector) if detector else None)

"""The sensor that finds what a detector would, without images: by a model that was fitted to rendered captures."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import exp
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np

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
from pavetwin.sensing.frame import Box, Frame
from pavetwin.sensing.looks import LookMeter
from pavetwin.sensing.registered import sensor
from pavetwin.sensing.sensor_model import SensorModel

_BLOCK: Final = 1024
"""Frames whose first random numbers are drawn together."""


@sensor("calibrated")
class Calibrated(Sensor):
    """Finds defects with the chances of a file of `pavetwin sensor fit`, and reports as many false alarms.

    A look finds its defect by class, severity, size in pixels, visible fraction, place in the image, motion blur and
    light; what a defect keeps from look to look is drawn once for it (`pavetwin.sensing.sensor_model`). False alarms
    are a Poisson process on the ground of each image.
    """

    every_capture = True
    sees_confirmed = True
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
        self._expected_at: dict[tuple[float, tuple[int, int]], dict[str, float]] = {}

    def _opened(self) -> SensorModel:
        fitted, detector = str(self.options["fitted"]), str(self.options["model"])
        if not fitted:
            raise PaveTwinError(
                "The sensor 'calibrated' needs a file of `pavetwin sensor fit`: name it by `model`, as in sensor.json."
            )
        return _read(fitted, file_sha256(Path(fitted)), detector)

    def detect(self, frame: Frame) -> Sequence[Detection]:
        correlation = self.model.correlation
        found = [
            Detection.of(sighting)
            for sighting in frame.sightings
            if look_draw(self.seed, sighting.defect.id, sighting.attempt, correlation)
            < self.model.chance(self._meter.look(frame, sighting))
        ]
        return [*found, *self._false_alarms(frame)]

    def _false_alarms(self, frame: Frame) -> list[Detection]:
        """Of each frame by its number and the seed alone; most frames have none, which one number tells."""
        expected = self._expected(frame)
        if not expected or _drawn(self.seed, frame.number) < exp(-sum(expected.values())):
            return []
        generator = child(self.seed, Stream.FALSE_ALARMS, 1, frame.number)
        width, height = frame.camera.image_px
        scale = self._meter.pixel_m(frame) / frame.ground_resolution_m
        alarms = []
        for kind, count in self._counts(generator, expected):
            side = scale * self.model.false_alarms[kind].size_px
            for left, top in generator.random((count, 2)):
                corner = left * max(width - side, 0.0), top * max(height - side, 0.0)
                box: Box = (*corner, min(corner[0] + side, width), min(corner[1] + side, height))
                alarms.append(Detection(kind, self.model.detector.confidence, box_px=box))
        return alarms

    def _counts(self, generator: np.random.Generator, expected: Mapping[str, float]) -> list[tuple[str, int]]:
        """How many of each class, of at least one in all."""
        while True:
            counts = generator.poisson(list(expected.values()))
            if counts.any():
                return list(zip(expected, map(int, counts), strict=True))

    def _expected(self, frame: Frame) -> dict[str, float]:
        """The expected number of each class in an image."""
        place = frame.altitude_m, frame.camera.image_px
        if place not in self._expected_at:
            own_m, (width, height) = frame.ground_resolution_m, frame.camera.image_px
            pixel_m, area_m2 = self._meter.pixel_m(frame), own_m**2 * width * height
            self._expected_at[place] = {
                kind: area_m2 * each.per_m2(pixel_m) for kind, each in self.model.false_alarms.items()
            }
        return self._expected_at[place]


def _drawn(seed: int, frame: int) -> float:
    """A frame's first random number, uniform in 0 … 1: whether it has false alarms."""
    return float(_block(seed, frame // _BLOCK)[frame % _BLOCK])


@lru_cache(maxsize=64)
def _block(seed: int, number: int) -> Float64Array:
    return child(seed, Stream.FALSE_ALARMS, 0, number).random(_BLOCK)


@lru_cache(maxsize=16)
def _read(fitted: str, content: str, detector: str) -> SensorModel:  # noqa: ARG001 - it is of the cache's key
    """A fitted sensor, read again only when its content has changed."""
    return SensorModel.read(Path(fitted), model_path(detector) if detector else None)

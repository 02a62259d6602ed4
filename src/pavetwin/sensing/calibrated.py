"""The sensor that finds what a detector would, without images: by a model that was fitted to rendered captures."""

from cmath import rect
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Complex128Array, Float64Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
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
from pavetwin.sensing.shipped import DEFAULT, sensor_path

_BLOCK: Final = 128
"""Frames whose false alarms are drawn together."""

_CORNERS: Final = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)))


@sensor("calibrated")
class Calibrated(Sensor):
    """Finds defects with the chances of a fitted sensor, one that ships or a file of `pavetwin sensor fit`, and reports
    as many false alarms.

    A look finds its defect by class, severity, size in pixels, visible fraction, place in the image, motion blur and
    light; what a defect keeps from look to look is drawn once for it (`pavetwin.sensing.sensor_model`). False alarms
    are a Poisson process on the ground of each image.
    """

    every_capture = True
    sees_confirmed = True
    is_fitted = True
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({"fitted": DEFAULT, "model": ""})

    def __init__(self, settings: SensingSettings, seed: int, model: SensorModel | None = None) -> None:
        """Args:
            model: in place of the one that the option `fitted` names.

        Raises:
            PaveTwinError: there is none of that name, its file is damaged, or it was fitted for another detector than
                the one that the option `model` names.
        """
        super().__init__(settings, seed)
        self.model = model or self._opened()
        self._meter = LookMeter(self.model.detector.image_px)
        self._looks: dict[int, dict[int, Look]] = {}
        """By defect and attempt."""
        self._alarms_at: dict[tuple[float, tuple[int, int]], _Alarms] = {}

    def _opened(self) -> SensorModel:
        file, detector = sensor_path(str(self.options["fitted"])), str(self.options["model"])
        return _read(file, file_sha256(file), detector)

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
        drawn = _block(self.seed, frame.number // _BLOCK, self._alarms(frame)).get(frame.number % _BLOCK)
        if drawn is None:
            return []
        kinds, corners = drawn
        rings = (corners * rect(1.0, frame.yaw_rad) + complex(*frame.position)).view(np.float64)
        shapes: list[Polygon] = np.asarray(shapely.polygons(rings.reshape(*corners.shape, 2))).tolist()
        confidence = self.model.detector.confidence
        return [
            Detection(kind, confidence, shape, means_nothing=True) for kind, shape in zip(kinds, shapes, strict=True)
        ]

    def _alarms(self, frame: Frame) -> "_Alarms":
        place = frame.altitude_m, frame.camera.image_px
        if place not in self._alarms_at:
            across_m, along_m = (frame.ground_resolution_m * side for side in frame.camera.image_px)
            pixel_m, alarms = self._meter.pixel_m(frame), self.model.false_alarms
            self._alarms_at[place] = _Alarms(
                across_m,
                along_m,
                tuple(alarms),
                tuple(across_m * along_m * each.per_m2(pixel_m) for each in alarms.values()),
                tuple(pixel_m * each.size_px for each in alarms.values()),
            )
        return self._alarms_at[place]


class _Alarms(NamedTuple):
    """The false alarms in images of one size on the ground; the last three by class."""

    across_m: float
    along_m: float
    kinds: tuple[str, ...]
    expected: tuple[float, ...]
    """In an image."""
    sides_m: tuple[float, ...]


@lru_cache(maxsize=256)
def _block(seed: int, number: int, alarms: _Alarms) -> dict[int, tuple[list[str], Complex128Array]]:
    """The false alarms of `_BLOCK` frames: by frame, the class of each, and the corners of its outline.

    The corners are (alarms, 5) complex numbers in metres: ahead of the image's centre, and 1j to its left.
    """
    generator = child(seed, Stream.FALSE_ALARMS, number)
    counts = generator.poisson(alarms.expected, (_BLOCK, len(alarms.expected)))
    frames, kinds = (np.repeat(each.ravel(), counts.ravel()) for each in np.indices(counts.shape))
    size_m = np.array((alarms.across_m, alarms.along_m))
    sides_m = np.minimum(np.array(alarms.sides_m)[kinds, None], size_m)
    left, top = generator.random((len(frames), 2)).T
    centres = np.column_stack([left - 0.5, 0.5 - top]) * (size_m - sides_m)
    right, ahead = np.moveaxis(centres[:, None] + _CORNERS * sides_m[:, None] / 2, 2, 0)
    corners = ahead - 1j * right
    return {
        int(frame): ([alarms.kinds[kind] for kind in kinds[frames == frame].tolist()], corners[frames == frame])
        for frame in np.unique(frames)
    }


@lru_cache(maxsize=16)
def _read(fitted: Path, content: str, detector: str) -> SensorModel:  # noqa: ARG001 - it is of the cache's key
    """A fitted sensor, read again only when its content has changed."""
    return SensorModel.read(fitted, model_path(detector) if detector else None)

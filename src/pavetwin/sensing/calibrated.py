"""The sensor that finds what a detector would, without images: by a model that was fitted to rendered captures."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.files import file_sha256
from pavetwin.perception.shipped import model_path
from pavetwin.seeds import Stream, child
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.draws import look_quantile
from pavetwin.sensing.frame import Frame
from pavetwin.sensing.look_scores import LookScorer
from pavetwin.sensing.looks import Look, LookMeter
from pavetwin.sensing.registered import sensor
from pavetwin.sensing.sensor_model import SensorModel
from pavetwin.sensing.shipped import DEFAULT, sensor_path

_BLOCK: Final = 128
"""Frames whose false alarms are drawn together."""


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
    model_options = ("fitted",)

    def __init__(self, settings: SensingSettings, seed: int, model: SensorModel | None = None) -> None:
        """Args:
            model: in place of the one that the option `fitted` names.

        Raises:
            PaveTwinError: there is none of that name, its file is damaged, or it was fitted for another detector than
                the one that the option `model` names.
        """
        super().__init__(settings, seed)
        self.model, self._meter, self._scorer = _Opened.of(model) if model else self._opened()
        self._shown: list[Frame] = []
        """Those with sightings."""
        self._blocks: dict[tuple[int, float, tuple[int, int]], Mapping[int, Sequence[Detection]]] = {}
        """False alarms by the number of the block, altitude and image size."""

    def _opened(self) -> "_Opened":
        file, detector = sensor_path(str(self.options["fitted"])), str(self.options["model"])
        return _read(file, file_sha256(file), detector)

    def detect(self, frame: Frame) -> Sequence[Detection]:
        alarms = self._false_alarms(frame)
        if not frame.sightings:
            return alarms
        self._shown.append(frame)
        seed, correlation = self.seed, self.model.correlation
        found = [
            report
            for sighting, score, report in self._scorer.scored(frame)
            if look_quantile(seed, sighting.defect.id, sighting.attempt, correlation) < score
        ]
        return [*found, *alarms]

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array:
        from pavetwin.sensing.fit.draws import found_by_draws

        looks: dict[int, list[Look]] = {defect: [] for defect in defects}
        for frame in self._shown:
            for sighting in frame.sightings:
                if sighting.defect.id in looks:
                    looks[sighting.defect.id].append(self._meter.look(frame, sighting))
        return found_by_draws(self.model, [*looks.values()])

    def _false_alarms(self, frame: Frame) -> Sequence[Detection]:
        """Squares of the usual size, of each frame by its number and the seed alone."""
        number, place = divmod(frame.number, _BLOCK)
        known = number, frame.altitude_m, frame.camera.image_px
        block = self._blocks.get(known)
        if block is None:
            block = self._blocks[known] = _block(self.seed, number, self._alarms(frame))
        return block.get(place, ())

    def _alarms(self, frame: Frame) -> "_Alarms":
        across_m, along_m = (frame.ground_resolution_m * side for side in frame.camera.image_px)
        pixel_m, alarms = self._meter.pixel_m(frame), self.model.false_alarms
        return _Alarms(
            frame.camera.image_px,
            self.model.detector.confidence,
            tuple(alarms),
            tuple(across_m * along_m * each.per_m2(pixel_m) for each in alarms.values()),
            tuple(each.size_px * pixel_m / frame.ground_resolution_m for each in alarms.values()),
        )


class _Alarms(NamedTuple):
    """The false alarms in images of one size on the ground; the last three by class."""

    image_px: tuple[int, int]
    """Of the camera."""
    confidence: float
    kinds: tuple[str, ...]
    expected: tuple[float, ...]
    """In an image."""
    sides_px: tuple[float, ...]
    """In pixels of the camera."""


@lru_cache(maxsize=64)
def _block(seed: int, number: int, alarms: _Alarms) -> Mapping[int, Sequence[Detection]]:
    """The false alarms of `_BLOCK` frames, by frame: all policies and poses have the same ones in their images."""
    generator = child(seed, Stream.FALSE_ALARMS, number)
    counts = generator.poisson(alarms.expected, (_BLOCK, len(alarms.expected)))
    frames, kinds = (np.repeat(each.ravel(), counts.ravel()) for each in np.indices(counts.shape))
    image_px = np.array(alarms.image_px)
    sides = np.minimum(np.array(alarms.sides_px)[kinds, None], image_px)
    corners = generator.random((len(frames), 2)) * (image_px - sides)
    boxes = np.hstack([corners, corners + sides]).tolist()
    drawn: dict[int, list[Detection]] = {}
    for frame, kind, box in zip(frames.tolist(), kinds.tolist(), boxes, strict=True):
        alarm = Detection(alarms.kinds[kind], alarms.confidence, box_px=tuple(box), means_nothing=True)
        drawn.setdefault(frame, []).append(alarm)
    return drawn


class _Opened(NamedTuple):
    """A fitted sensor, and what missions with it share."""

    model: SensorModel
    meter: LookMeter
    scorer: LookScorer

    @classmethod
    def of(cls, model: SensorModel) -> "_Opened":
        meter = LookMeter(model.detector.image_px)
        return cls(model, meter, LookScorer(model, meter))


@lru_cache(maxsize=16)
def _read(fitted: Path, content: str, detector: str) -> _Opened:  # noqa: ARG001 - it is of the cache's key
    """A fitted sensor, read again only when its content has changed."""
    return _Opened.of(SensorModel.read(fitted, model_path(detector) if detector else None))

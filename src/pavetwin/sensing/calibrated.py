"""The sensor that finds what a detector would, without images, by a model fitted to rendered captures."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from math import hypot, inf, log2, sin
from math import radians as to_radians
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.detections import NO_DETECTIONS, Detections
from pavetwin.files import file_sha256
from pavetwin.perception.model_file import model_path
from pavetwin.seeds import Stream, child
from pavetwin.sensing.fitted_sensor import DEFAULT, LEAST, SensorModel, of_defect, sensor_path
from pavetwin.sensing.frame import Frame, Look, LookMeter, Sighting, inside_share, shape_of
from pavetwin.sensing.recall import look_quantile
from pavetwin.sensing.sensor import Sensor, sensor
from pavetwin.uav.cameras import Camera

_MOST_SEEN: Final = 16384


class _Place(NamedTuple):
    """Values common to images from one height by one camera in one light."""

    camera: Camera
    altitude_m: float
    pixel_m: float
    """Side of a pixel on the ground, in the image that is searched."""
    inner_m: float
    """Distance from the image's centre to its nearest edge."""
    corner_m: float
    """Distance from the image's centre to its corners."""
    conditions: Conditions
    sun_elevation_deg: float | None
    light: float
    """Term of the score for sun, clouds and an image without motion blur, the same for all classes."""
    blur: float
    """Term of the score for a metre of motion per second of exposure."""


class _Seen(NamedTuple):
    """A defect at one ground resolution."""

    sighting: Sighting
    """Keeps the outline alive, whose identity is the key."""
    score: float
    """Score of a whole look without blur in the image's centre, without the term for light."""
    inside: float
    visible: float
    off_centre: float
    """Weights of these variables."""
    x: float
    y: float
    reach_m: float


ScoredLook = tuple[Sighting, float]
"""A sighting, and the score of the look, x · β / √(1 + σ²): a single look finds its defect with the chance Φ(score).
The score is −∞ for a class without looks."""


class LookScorer:
    """Scores looks as `SensorModel.chance` does, in a fraction of the time; missions with one sensor share it."""

    def __init__(self, model: SensorModel, meter: LookMeter) -> None:
        """Args:
        meter: measures looks in the pixels of the images that the detector searches.
        """
        self._model, self._meter = model, meter
        self._place: _Place | None = None
        self._seen: dict[tuple[int, float], _Seen] = {}
        """Keys: the identity of the defect's outline, and the side of a pixel."""

    def scored(self, frame: Frame) -> list[ScoredLook]:
        """Looks of a frame at its sightings, in their order."""
        place = self._place
        if place is None or not _is_at(place, frame):
            place = self._place = self._placed(frame)
        common = place.light + place.blur * hypot(*frame.velocity_mps) * frame.exposure_s
        east, north = frame.position
        looks = []
        for sighting in frame.sightings:
            seen = self._seen.get((id(sighting.defect.polygon), place.pixel_m)) or self._owned(sighting, place)
            away_m = hypot(seen.x - east, seen.y - north)
            score = (
                seen.score
                + common
                + seen.visible * log2(max(sighting.visible_fraction, LEAST))
                + seen.off_centre * min(1.0, away_m / place.corner_m) ** 2
            )
            if away_m + seen.reach_m > place.inner_m:
                score += seen.inside * log2(max(inside_share(frame, sighting.defect.polygon), LEAST))
            looks.append((sighting, score))
        return looks

    def _placed(self, frame: Frame) -> _Place:
        own_m, pixel_m = frame.ground_resolution_m, self._meter.pixel_m(frame)
        sides, effects = frame.camera.image_px, self._model.effects_of_all
        light = effects["blur"].at(0.0) + effects["clouds"].at(frame.conditions.clouds)
        if frame.sun_elevation_deg is not None:
            light += effects["sun"].at(sin(to_radians(frame.sun_elevation_deg)))
        return _Place(
            camera=frame.camera,
            altitude_m=frame.altitude_m,
            pixel_m=pixel_m,
            inner_m=own_m * min(sides) / 2,
            corner_m=own_m * hypot(*sides) / 2,
            conditions=frame.conditions,
            sun_elevation_deg=frame.sun_elevation_deg,
            light=light,
            blur=effects["blur"].weight / pixel_m,
        )

    def _owned(self, sighting: Sighting, place: _Place) -> _Seen:
        defect, model = sighting.defect, self._model
        shape, effects = shape_of(defect.polygon), model.effects_of(defect.kind)
        score = -inf
        inside = visible = off_centre = 0.0
        if effects is not None:
            own = of_defect(
                severity=str(defect.severity),
                width_px=defect.width_m / place.pixel_m,
                size_px=shape.size_m / place.pixel_m,
                pixel_mm=1000.0 * place.pixel_m,
            )
            whole = {**own, "inside": 0.0, "visible": 0.0, "off_centre": 0.0}
            score = model.level_of(defect.kind, own["size"]) + sum(effects[name].at(it) for name, it in whole.items())
            inside, visible, off_centre = (effects[name].weight for name in ("inside", "visible", "off_centre"))
        if len(self._seen) >= _MOST_SEEN:
            self._seen.clear()
        self._seen[id(defect.polygon), place.pixel_m] = made = _Seen(
            sighting, score, inside, visible, off_centre, shape.x, shape.y, shape.reach_m
        )
        return made


def _is_at(place: _Place, frame: Frame) -> bool:
    """Whether a frame is taken from this place."""
    return (
        place.camera is frame.camera
        and place.altitude_m == frame.altitude_m
        and place.conditions is frame.conditions
        and place.sun_elevation_deg == frame.sun_elevation_deg
    )


_BLOCK: Final = 128
"""Frames whose false alarms are drawn together."""


@sensor("calibrated")
class Calibrated(Sensor):
    """Sensor that finds defects with the probabilities of a fitted sensor, and reports its rate of false alarms.

    The fitted sensor ships or is a file of `pavetwin sensor fit`. The probability of a look depends on class, severity,
    size in pixels, visible fraction, place in the image, motion blur and light; the random effect of a defect is drawn
    once (`pavetwin.sensing.fitted_sensor`). False alarms are a Poisson process on the ground of each image.
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
            PaveTwinError: there is no fitted sensor of that name, its file is damaged, or it was fitted for another
                detector than the option `model` names.
        """
        super().__init__(settings, seed)
        self.model, self._meter, self._scorer = _Opened.of(model) if model else self._opened()
        self._shown: list[Frame] = []
        """Frames with sightings."""
        self._blocks: dict[tuple[int, float, tuple[int, int]], Mapping[int, Detections]] = {}
        """False alarms by number of the block, altitude and image size."""

    def _opened(self) -> "_Opened":
        file, detector = sensor_path(str(self.options["fitted"])), str(self.options["model"])
        return _read(file, file_sha256(file), detector)

    def detect(self, frame: Frame) -> Detections:
        alarms = self._false_alarms(frame)
        if not frame.sightings:
            return alarms
        self._shown.append(frame)
        seed, correlation = self.seed, self.model.correlation
        found = Detections.of_defects(
            sighting.defect
            for sighting, score in self._scorer.scored(frame)
            if look_quantile(seed, sighting.defect.id, sighting.attempt, correlation) < score
        )
        return Detections.concatenated([found, alarms])

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array:
        from pavetwin.sensing.fit.fitting import found_by_draws

        looks: dict[int, list[Look]] = {defect: [] for defect in defects}
        for frame in self._shown:
            for sighting in frame.sightings:
                if sighting.defect.id in looks:
                    looks[sighting.defect.id].append(self._meter.look(frame, sighting))
        return found_by_draws(self.model, [*looks.values()])

    def _false_alarms(self, frame: Frame) -> Detections:
        """Squares of the usual size; a frame's depend on its number and the seed alone."""
        number, place = divmod(frame.number, _BLOCK)
        known = number, frame.altitude_m, frame.camera.image_px
        block = self._blocks.get(known)
        if block is None:
            block = self._blocks[known] = _block(self.seed, number, self._alarms(frame))
        return block.get(place, NO_DETECTIONS)

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
    """False alarms in images of one size on the ground; the last three fields have a value for each class."""

    image_px: tuple[int, int]
    """Image size of the camera."""
    confidence: float
    classes: tuple[str, ...]
    expected: tuple[float, ...]
    """Mean number in an image."""
    sides_px: tuple[float, ...]
    """Side of a square, in pixels of the camera."""


@lru_cache(maxsize=64)
def _block(seed: int, number: int, alarms: _Alarms) -> Mapping[int, Detections]:
    """False alarms of `_BLOCK` frames, by frame; the same in the images of all policies and poses."""
    generator = child(seed, Stream.FALSE_ALARMS, number)
    counts = generator.poisson(alarms.expected, (_BLOCK, len(alarms.expected)))
    frames, kinds = (np.repeat(each.ravel(), counts.ravel()) for each in np.indices(counts.shape))
    image_px = np.array(alarms.image_px)
    sides = np.minimum(np.array(alarms.sides_px)[kinds, None], image_px)
    corners = generator.random((len(frames), 2)) * (image_px - sides)
    drawn = Detections(
        [alarms.classes[kind] for kind in kinds],
        alarms.confidence,
        box_px=np.hstack([corners, corners + sides]),
        is_spurious=np.ones(len(frames), dtype=np.bool_),
    )
    first = np.flatnonzero(np.diff(frames, prepend=-1))
    return {int(frames[start]): drawn[start:end] for start, end in pairwise([*first.tolist(), len(frames)])}


class _Opened(NamedTuple):
    """A fitted sensor, and the scores that missions with it share."""

    model: SensorModel
    meter: LookMeter
    scorer: LookScorer

    @classmethod
    def of(cls, model: SensorModel) -> "_Opened":
        meter = LookMeter(model.detector.image_px)
        return cls(model, meter, LookScorer(model, meter))


@lru_cache(maxsize=16)
def _read(fitted: Path, content: str, detector: str) -> _Opened:  # noqa: ARG001 - part of the cache's key
    """A fitted sensor, read again when its content has changed."""
    return _Opened.of(SensorModel.read(fitted, model_path(detector) if detector else None))

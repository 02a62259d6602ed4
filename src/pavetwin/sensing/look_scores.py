"""The scores of looks under a fitted sensor, computed as a mission flies: what belongs to a defect only once."""

from math import hypot, inf, log2, sin
from math import radians as to_radians
from typing import Final, NamedTuple

from pavetwin.config.conditions import Conditions
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.looks import LookMeter, inside_share, shape_of
from pavetwin.sensing.sensor_model import LEAST, SensorModel, of_defect
from pavetwin.uav.cameras import Camera

_MOST_SEEN: Final = 16384


class _Place(NamedTuple):
    """What images from one height by one camera in one light have in common."""

    camera: Camera
    altitude_m: float
    pixel_m: float
    """Side of a pixel on the ground, in the image that is looked at."""
    inner_m: float
    """From the image's centre to its nearest edge."""
    corner_m: float
    """From the image's centre to its corners."""
    conditions: Conditions
    sun_elevation_deg: float | None
    light: float
    """What sun and clouds add to the score, whatever the class, and a picture without motion blur."""
    blur: float
    """What a metre per second adds."""


class _Seen(NamedTuple):
    """A defect at one ground resolution."""

    sighting: Sighting
    """Keeps its outline alive, by whose identity it is found."""
    score: float
    """Of a whole look without blur in the image's centre, light left out."""
    inside: float
    visible: float
    off_centre: float
    """What a unit of each variable adds."""
    x: float
    y: float
    reach_m: float
    report: Detection
    """That outlines it exactly."""


ScoredLook = tuple[Sighting, float, Detection]
"""A sighting; the score of the look, x · β / √(1 + σ²): a single look finds its defect with the chance Φ(score), which
is −∞ for a class without looks; and what reports the defect's own outline."""


class LookScorer:
    """Scores looks as `SensorModel.chance` does, in a fraction of the time; missions with one sensor share it."""

    def __init__(self, model: SensorModel, meter: LookMeter) -> None:
        """Args:
        meter: says how large the pixels are that the detector looks at.
        """
        self._model, self._meter = model, meter
        self._place: _Place | None = None
        self._seen: dict[tuple[int, float], _Seen] = {}
        """By the identity of the defect's outline, and the side of a pixel."""

    def scored(self, frame: Frame) -> list[ScoredLook]:
        """The looks that a frame has at its sightings, in their order."""
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
            looks.append((sighting, score, seen.report))
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
            sighting, score, inside, visible, off_centre, shape.x, shape.y, shape.reach_m, Detection.of(sighting)
        )
        return made


def _is_at(place: _Place, frame: Frame) -> bool:
    """Whether a frame is taken from there."""
    return (
        place.camera is frame.camera
        and place.altitude_m == frame.altitude_m
        and place.conditions is frame.conditions
        and place.sun_elevation_deg == frame.sun_elevation_deg
    )

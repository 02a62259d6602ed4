"""The sensor that finds a defect with the detector's recall, less where it covers few pixels."""

from collections.abc import Sequence

from pavetwin.config.mission import SensingSettings
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.draws import look_draw
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.registered import sensor
from pavetwin.sensing.resolution import sighted_share


@sensor("recall")
class Recall(Sensor):
    """Reports a sighting with a probability p, at most `recall` (0.840, the YOLOv8n of arXiv 2606.20742).

    p falls with the pixels that the defect covers (`pavetwin.sensing.resolution`). Looks at one defect are not
    independent: with u drawn once for the defect and e for each look, both standard normal, and ρ `look_correlation`,
    z = √ρ · u + √(1 − ρ) · e, and the look finds it where Φ(z) < p. So every single look finds it with exactly the
    probability p, and any two z of a defect have the correlation ρ (a Gaussian copula).
    """

    judges_size = True

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: `sensing.least_px` names a class that is not known.
        """
        super().__init__(settings, seed)
        known = DEFECT_CLASSES.names()
        for kind in settings.least_px or {}:
            if kind not in known:
                raise PaveTwinError(
                    f"sensing.least_px: no defect class '{kind}'{nearest_name(kind, known)}; known are "
                    f"{', '.join(known)}."
                )

    def detect(self, frame: Frame) -> Sequence[Detection]:
        return [
            Detection.of(sighting)
            for sighting in frame.sightings
            if look_draw(self.seed, sighting.defect.id, sighting.attempt, self.settings.look_correlation)
            < self.chance(frame, sighting)
        ]

    def chance(self, frame: Frame, sighting: Sighting) -> float:
        """The probability that a look finds what it sees."""
        return self.settings.recall * sighted_share(self.settings, frame, sighting)

"""What a sensor is."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Final

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue, checked_options
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame

PARAMETER_DRAWS: Final = 20
"""Of a fitted sensor's parameters: the same in all missions with it."""


class Sensor(ABC):
    """Reports what it finds in a frame. It may miss what is there and report what is not."""

    name: str = ""
    every_capture: ClassVar[bool] = False
    """Whether it is shown every capture; else only those that see a defect which is not confirmed yet."""

    sees_confirmed: ClassVar[bool] = False
    """Whether it is also shown defects that are confirmed already, as one is that works on images."""

    judges_size: ClassVar[bool] = False
    """Whether it misses what covers too few pixels, by `sensing.least_px`."""

    other_classes: ClassVar[frozenset[str]] = frozenset()
    """Classes it reports that are not defects, beside `person` and `car`: such detections are ignored. Any other class
    that is not registered is an error."""
    is_fitted: ClassVar[bool] = False
    """Whether its parameters were fitted, so that it answers `found_by_draws`."""
    is_reused: ClassVar[bool] = False
    """Whether one may serve several missions over the same world, defects, traffic and parked vehicles, under the same
    settings and seed: it then looks only once at the captures that these have in common."""
    after_landing: bool = False
    """Whether the mission is flown before it looks at any capture: it is then handed all of them, see `look_at`, and
    policies know nothing of what is found."""
    measures_sizes: bool = False
    """Whether its detections have `measures`, and it reports all that it sees: the condition index of a road then
    follows from what it detects. Of the class whether some do; one may say of itself that it does not."""
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({})
    """The options that it has, with the values that hold where `sensing.options` gives none. A value must have the type
    of its default; a whole number is a number too."""
    model_options: ClassVar[tuple[str, ...]] = ()
    """Options whose default names a model that ships, which another version may replace by another: missions and
    studies write down the one that they were flown with."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: it has no such option, or a value is of another type.
        """
        self.settings = settings
        self.seed = seed
        self.options: Mapping[str, OptionValue] = checked_options(
            settings.options,
            self.default_options,
            key="sensing.options",
            owner=f"the sensor '{self.name or type(self).__name__}'",
        )
        """The value of every option."""

    def look_at(
        self,
        frames: Sequence[Frame],  # noqa: ARG002 - for those that look after landing
        on_progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Prepare its answers for the captures of a mission, together; `detect` is asked for each of them afterwards.

        Args:
            frames: of the whole mission, in the order of time, without sightings.
            on_progress: told the share done, 0 … 1.
        """
        on_progress(1.0)

    @property
    def looked_px(self) -> int | None:
        """Longer side of the images that it looks at, unless the camera's is shorter; None for one without images.

        With one, each capture that it is shown is an attempt at all that it sees, and missions write down which of
        these it found.
        """
        return None

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array | None:  # noqa: ARG002 - for fitted sensors
        """How likely the looks that it was shown find each defect, in draws of what is not certain of the sensor.

        Args:
            defects: their ids.

        Returns:
            (`PARAMETER_DRAWS`, defects); None of a sensor whose parameters are stated, not fitted.
        """
        return None

    @abstractmethod
    def detect(self, frame: Frame) -> Sequence[Detection]:
        """What it finds in a frame.

        Policies are compared under the same random numbers: what a sensor draws for a defect's k-th attempt must
        depend on (seed, defect, k) alone, and what it draws for a false alarm on the seed and the frame alone.
        """

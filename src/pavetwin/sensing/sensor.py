"""The base class of sensors."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Final

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue, checked_options
from pavetwin.detections import Detections
from pavetwin.errors import nearest_name
from pavetwin.labels.class_names import TRAFFIC
from pavetwin.sensing.frame import Frame

PARAMETER_DRAWS: Final = 20
"""Number of draws of a fitted sensor's parameters, the same in all missions with it."""


class Sensor(ABC):
    """Reports detections in a frame. It may miss defects, and report false alarms."""

    name: str = ""
    every_capture: ClassVar[bool] = False
    """Whether it is shown every capture, instead of only those that see a defect which is not confirmed yet."""

    sees_confirmed: ClassVar[bool] = False
    """Whether sightings include defects that are confirmed already, as for a sensor that searches images."""

    judges_size: ClassVar[bool] = False
    """Whether it misses defects that cover too few pixels, by `sensing.least_px`."""

    other_classes: ClassVar[frozenset[str]] = frozenset()
    """Classes that it reports besides defects, `person` and `car`: such detections are ignored. Any other class that is
    not registered is an error."""
    is_fitted: ClassVar[bool] = False
    """Whether its parameters are fitted, so that it implements `found_by_draws`."""
    is_reused: ClassVar[bool] = False
    """Whether one instance may serve several missions over the same world, defects, traffic and parked vehicles, under
    the same settings and seed: it then searches the captures that they share only once."""
    after_landing: bool = False
    """Whether the mission is flown before it looks at any capture: it is then handed all of them, see `look_at`, and
    policies know nothing of what is found."""
    measures_sizes: bool = False
    """Whether its detections have sizes and `pixel_mm`, and it reports all that it sees: the condition index of a road
    then follows from its detections. An instance may override its class."""
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({})
    """Options with their defaults. A value in `sensing.options` must have the type of its default; a whole number is a
    number too."""
    model_options: ClassVar[tuple[str, ...]] = ()
    """Options whose default names a shipped model, which another version may replace: missions and studies store the
    one in use."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: there is no such option, or a value is of another type.
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
        """Prepare the detections of a mission's captures together; `detect` is called for each of them afterwards.

        Args:
            frames: all captures of the mission, in the order of time, without sightings.
            on_progress: called with the share done, 0 … 1.
        """
        on_progress(1.0)

    @property
    def looked_px(self) -> int | None:
        """Longer side of the images that it searches, unless the camera's is shorter; None for a sensor without images.

        For a sensor with images, each capture is an attempt at every defect in it, and missions store which it found.
        """
        return None

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array | None:  # noqa: ARG002 - for fitted sensors
        """Probability that the looks so far find each defect, in draws of the sensor's uncertain parameters.

        Args:
            defects: ids.

        Returns:
            (`PARAMETER_DRAWS`, defects); None for a sensor whose parameters are stated, not fitted.
        """
        return None

    @abstractmethod
    def detect(self, frame: Frame) -> Detections:
        """Detections in a frame.

        Each has a class, a confidence, and at least one of a `footprint` in the world frame and a `box_px` in the
        frame's image. Policies are compared under the same random numbers: the draw for a defect's k-th attempt must
        depend on (seed, defect, k) alone, and the draw for a false alarm on the seed and the frame alone.
        """


def unknown_class(class_name: str, defects: Collection[str], others: Collection[str]) -> str:
    """Message on a detection's class; empty for a known one.

    Args:
        defects: the classes of defects.
        others: other classes of the sensor, see `Sensor.other_classes`.
    """
    if class_name in defects or class_name in TRAFFIC or class_name in others:
        return ""
    near = nearest_name(class_name.lower().replace(" ", "_"), defects)
    return (
        f"the class '{class_name}', which is not a class of defects{near}; known are {', '.join(sorted(defects))}. A "
        "class that is not a defect belongs in its `other_classes`"
    )

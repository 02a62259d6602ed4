"""What a sensor is."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

from pavetwin.config.mission import OptionValue, SensingSettings
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame


class Sensor(ABC):
    """Reports what it finds in a frame. It may miss what is there and report what is not."""

    name: str = ""
    every_capture: ClassVar[bool] = False
    """Whether it is shown every capture; else only those that see a defect which is not confirmed yet."""

    other_classes: ClassVar[frozenset[str]] = frozenset()
    """Classes it reports that are not defects, beside `person` and `car`: such detections are ignored. Any other class
    that is not registered is an error."""
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({})
    """The options that it has, with the values that hold where `sensing.options` gives none. A value must have the type
    of its default; a whole number is a number too."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: it has no such option, or a value is of another type.
        """
        self.settings = settings
        self.seed = seed
        self.options: Mapping[str, OptionValue] = {**self.default_options, **self._given(settings.options)}
        """The value of every option."""

    @abstractmethod
    def detect(self, frame: Frame) -> Sequence[Detection]:
        """What it finds in a frame.

        Policies are compared under the same random numbers: what a sensor draws for a defect's k-th attempt must
        depend on (seed, defect, k) alone, and what it draws for a false alarm on the seed and the frame alone.
        """

    def _given(self, options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
        """The options that were set, once they fit."""
        name, known = self.name or type(self).__name__, self.default_options
        for option, value in options.items():
            if option not in known:
                near = f"{nearest_name(option, known)}; known are {', '.join(known)}" if known else "; it has none"
                raise PaveTwinError(f"sensing.options: the sensor '{name}' has no option '{option}'{near}.")
            wanted = type(known[option])
            if type(value) is not wanted and not (wanted is float and type(value) is int):
                raise PaveTwinError(
                    f"sensing.options.{option}: the sensor '{name}' expects {_TYPES[wanted]} such as {known[option]!r} "
                    f"(got {value!r})."
                )
        return {option: float(value) if type(known[option]) is float else value for option, value in options.items()}


_TYPES: Mapping[type, str] = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}

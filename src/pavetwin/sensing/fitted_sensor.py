"""Fitted sensors: chances of detection that were fitted to one detector, their files, and the ones that ship."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from math import exp, log, log2, radians, sin, sqrt
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any, Final, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from pavetwin.arrays import Float64Array
from pavetwin.config.settings import NonNegative, Positive, Settings, Share
from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, file_sha256, writing
from pavetwin.perception import model_file as shipped
from pavetwin.sensing.frame import Look


class FittedNumber(Settings):
    """A number that was fitted, with its standard error."""

    estimate: float
    standard_error: NonNegative


OF_ENTRY: Final = ("confidence", "looks", "size")
"""Variables of an entry, whose effects all classes share."""

SIZE_PX: Final = 32.0
"""Root of the area of a footprint from which sizes are counted, in pixels."""

_LEAST: Final = 0.01
"""Confidences nearer to 0 and 1 count as this near."""


def entry_values(confidence: float, looks: int, size_px: float) -> tuple[float, float, float]:
    """The variables of an entry, in the order of `OF_ENTRY`."""
    sure = min(max(confidence, _LEAST), 1.0 - _LEAST)
    return log(sure / (1.0 - sure)), log2(max(looks, 1)), log2(max(size_px, 1.0) / SIZE_PX)


class EntryModel(Settings):
    """The part of a fitted sensor that judges entries of inventories."""

    terms: Mapping[str, FittedNumber]
    """β: each class by its name, and `OF_ENTRY`."""
    entries: Annotated[int, Field(ge=1)]
    """Number of entries in the fit."""
    defect_share: Share
    """Share of them that show a defect."""
    severities: Mapping[str, tuple[NonNegative, NonNegative, NonNegative]]
    """Shares of low, medium and high among the defects of these missions, keyed by class."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if missing := [name for name in OF_ENTRY if name not in self.terms]:
            raise ValueError(f"`terms` has no '{missing[0]}'")
        if not 0.0 < self.defect_share < 1.0:
            raise ValueError("`defect_share` is above 0 and below 1")
        if set(self.severities) != set(self.terms) - set(OF_ENTRY):
            raise ValueError("`severities` are those of the classes in `terms`")
        if any(sum(shares) <= 0 for shares in self.severities.values()):
            raise ValueError("`severities` of a class have a sum above 0")
        return self

    def chance(self, kind: str, confidence: float, looks: int, size_px: float) -> float | None:
        """The probability that an entry shows a defect; None for a class that it was not fitted to.

        Args:
            kind: class of the defect, such as `pothole`.
            looks: how many images show it.
            size_px: root of the area of its footprint, in pixels.
        """
        if kind not in self.severities:
            return None
        values = entry_values(confidence, looks, size_px)
        score = self.terms[kind].estimate
        score += sum(self.terms[name].estimate * value for name, value in zip(OF_ENTRY, values, strict=True))
        return 1.0 / (1.0 + exp(-min(max(score, -30.0), 30.0)))


SEVERITIES: Final[Mapping[str, float]] = {"low": -1.0, "medium": 0.0, "high": 1.0}

OF_CLASS: Final = ("width", "size", "inside", "severity")
"""Variables whose effect each class has for itself."""

OF_ALL: Final = ("resolution", "visible", "off_centre", "blur", "sun", "clouds")
"""Variables whose effect is the same for all classes."""

BEND: Final = "bend"
"""The second term of the size, of each class."""

LEAST: Final = 0.02
"""Shares and pixels below this count as this much: their logarithms stay finite."""

_NORMAL: Final = NormalDist()


def values_of(look: Look) -> dict[str, float | None]:
    """The variables of a look, by the names of `OF_CLASS` and `OF_ALL`; None where one is not known."""
    sun_deg = look.sun_elevation_deg
    return {
        **of_defect(look.severity, look.width_px, look.size_px, look.pixel_mm),
        "inside": log2(max(look.inside_fraction, LEAST)),
        "visible": log2(max(look.visible_fraction, LEAST)),
        "off_centre": look.off_centre**2,
        "blur": look.blur_px,
        "sun": None if sun_deg is None else sin(radians(sun_deg)),
        "clouds": look.clouds,
    }


def of_defect(severity: str, width_px: float, size_px: float, pixel_mm: float) -> dict[str, float]:
    """The variables that are the same for all looks at a defect at one ground resolution; arguments as in `Look`."""
    return {
        "width": log2(max(width_px, LEAST)),
        "size": log2(max(size_px, LEAST)),
        "severity": SEVERITIES.get(severity, 0.0),
        "resolution": log2(pixel_mm),
    }


def bend(size: float, knots: tuple[float, float, float]) -> float:
    """The second term of a natural cubic spline with three knots, in the unit of `size`: 0 below the first, linear
    above the last (Harrell 2015, Regression Modeling Strategies, eq. 2.25).

    Args:
        size: log₂ of the size in pixels.
    """
    low, middle, high = knots
    if size <= low:
        return 0.0
    share = (high - low) / (high - middle)
    cubes = (size - low) ** 3 - share * max(0.0, size - middle) ** 3 + (share - 1) * max(0.0, size - high) ** 3
    return cubes / (high - low) ** 2


class Variable(Settings):
    """Standardisation of a variable: its mean and its spread in the fitted looks."""

    centre: float
    scale: Positive


class Effect(NamedTuple):
    """Linear contribution of a variable to the score of a look."""

    weight: float
    """Score per unit."""
    centre: float
    """Value with no contribution."""

    def at(self, value: float) -> float:
        return self.weight * (value - self.centre)


class FittedDetector(Settings):
    """The detector that a sensor was fitted to, with its settings."""

    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    """SHA-256 of the model file."""
    confidence: Share
    """Least confidence of what is reported."""
    image_px: Annotated[int, Field(ge=1)]
    """Longer side of the images that it searches in missions, unless the camera's is shorter."""


class FittedTo(Settings):
    """The data of a fit."""

    looks: Annotated[int, Field(ge=1)]
    found: Annotated[int, Field(ge=0)]
    defects: Annotated[int, Field(ge=1)]
    repeated: Annotated[int, Field(ge=0)]
    """Defects with more than one look, from which the random effect follows."""
    images: Annotated[int, Field(ge=1)]
    area_m2: Positive
    """Area of the ground in all images."""
    pixel_mm: tuple[Positive, Positive]
    """The finest and the coarsest ground resolution."""
    sources: tuple[str, ...]
    """Names of the folders."""


class FalseAlarms(Settings):
    """False alarms of a class per m² of ground in an image: exp(level + slope · log₂ of the pixel's side in mm)."""

    level: FittedNumber
    slope: FittedNumber
    size_px: Positive
    """Median root of the area of their boxes."""

    def per_m2(self, pixel_m: float) -> float:
        """Expected number per m² in an image."""
        return exp(self.level.estimate + self.slope.estimate * log2(1000.0 * pixel_m))


class SensorModel(Settings):
    """The content of a file of `pavetwin sensor fit`."""

    pavetwin_sensor: int = FORMAT
    detector: FittedDetector
    fitted_to: FittedTo
    variables: Mapping[str, Variable]
    """The variables of `OF_CLASS` and `OF_ALL`."""
    knots: Mapping[str, tuple[float, float, float]]
    """Knots of the spline by class: rising log₂ of the size in pixels."""
    terms: Mapping[str, FittedNumber]
    """β: for each class its name, `class:variable` of `OF_CLASS`, and `class:bend`; and the variables of `OF_ALL`."""
    log_spread: FittedNumber
    """Natural logarithm of σ."""
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of the terms in their order, with `log_spread` last."""
    false_alarms: Mapping[str, FalseAlarms]
    """Keyed by class."""
    entries: EntryModel | None = None
    """Model of entries of inventories; None if no class had both right and wrong detections in the fitted missions."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        names = (*OF_CLASS, *OF_ALL)
        if set(self.variables) != set(names):
            raise ValueError(f"`variables` are {', '.join(names)}, each once")
        wanted = term_names(self.classes)
        if not self.classes or set(self.terms) != set(wanted):
            lacking = next(iter(set(wanted) ^ set(self.terms)), "any class")
            raise ValueError(f"`terms` do not fit together: see '{lacking}'")
        if set(self.knots) != set(self.classes) or any(not a < b < c for a, b, c in self.knots.values()):
            raise ValueError("`knots` are three rising numbers for each class")
        rows = np.array([len(row) for row in self.covariance])
        if len(rows) != len(self.terms) + 1 or (rows != len(rows)).any():
            raise ValueError(f"`covariance` has {len(self.terms) + 1} rows of as many numbers, as there are terms")
        matrix = np.array(self.covariance)
        if not np.allclose(matrix, matrix.T, atol=1e-6) or np.linalg.eigvalsh(matrix).min() < -1e-6:
            raise ValueError("`covariance` is not a covariance matrix")
        return self

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """Classes of the fit; any other is never found."""
        return tuple(name for name in self.terms if ":" not in name and name not in OF_ALL)

    @cached_property
    def spread(self) -> float:
        """σ"""
        return exp(self.log_spread.estimate)

    @cached_property
    def correlation(self) -> float:
        """Correlation between looks at one defect."""
        return self.spread**2 / (1 + self.spread**2)

    def row(self, look: Look) -> dict[str, float]:
        """x: the terms of a look that are not 0."""
        values = values_of(look)
        scaled = {
            name: 0.0 if values[name] is None else (values[name] - it.centre) / it.scale  # type: ignore[operator]
            for name, it in self.variables.items()
        }
        own = {f"{look.kind}:{name}": scaled[name] for name in OF_CLASS}
        own[f"{look.kind}:{BEND}"] = bend(values["size"], self.knots[look.kind]) / self.variables["size"].scale  # type: ignore[arg-type]
        return {look.kind: 1.0, **own, **{name: scaled[name] for name in OF_ALL}}

    def chance(self, look: Look) -> float:
        """The probability that a single look finds its defect; 0 for a class that it was not fitted to."""
        effects = self.effects_of(look.kind)
        if effects is None:
            return 0.0
        values = values_of(look)
        score = self.level_of(look.kind, values["size"])  # type: ignore[arg-type]
        return _NORMAL.cdf(score + sum(effects[name].at(it) for name, it in values.items() if it is not None))

    def level_of(self, kind: str, size: float) -> float:
        """The part of a look's score that is not a multiple of a variable: the class's own, and the bend of the size.

        Scores are x · β / √(1 + σ²), of which Φ is the chance of a single look.

        Args:
            size: log₂ of the size in pixels.
        """
        bent = self._estimates[f"{kind}:{BEND}"] / self.variables["size"].scale
        return (self._estimates[kind] + bent * bend(size, self.knots[kind])) / self._width

    def effects_of(self, kind: str) -> Mapping[str, Effect] | None:
        """The effect of each variable on looks at a class; None for a class that it was not fitted to."""
        return self._effects.get(kind)

    @cached_property
    def effects_of_all(self) -> Mapping[str, Effect]:
        """The effects of the variables of `OF_ALL`, the same for all classes."""
        return {name: self._effect(name, name) for name in OF_ALL}

    @cached_property
    def _effects(self) -> Mapping[str, Mapping[str, Effect]]:
        return {
            kind: {**{name: self._effect(f"{kind}:{name}", name) for name in OF_CLASS}, **self.effects_of_all}
            for kind in self.classes
        }

    def _effect(self, term: str, variable: str) -> Effect:
        it = self.variables[variable]
        return Effect(self._estimates[term] / it.scale / self._width, it.centre)

    @cached_property
    def _width(self) -> float:
        return sqrt(1 + self.spread**2)

    @cached_property
    def _estimates(self) -> dict[str, float]:
        return {name: term.estimate for name, term in self.terms.items()}

    def parameter_draws(self, count: int, seed: int = 0) -> Float64Array:
        """(count, terms + 1) draws of β and log σ from the normal distribution of their uncertainty."""
        mean = np.array([*self._estimates.values(), self.log_spread.estimate])
        values, vectors = np.linalg.eigh(np.array(self.covariance))
        normal = np.random.default_rng(seed).standard_normal((count, len(mean)))
        return np.asarray(mean + (normal * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)

    def save(self, path: Path) -> None:
        """Write it as JSON.

        Raises:
            PaveTwinError: the folder cannot be written.
        """
        content = self.model_dump(mode="json", exclude_none=True)
        rows = ",\n  ".join(json.dumps(row) for row in content.pop("covariance"))
        text = json.dumps(content, indent=1)[:-2] + f',\n "covariance": [\n  {rows}\n ]\n}}\n'
        with writing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    @classmethod
    def read(cls, path: Path, detector: Path | None = None) -> Self:
        """A file of `pavetwin sensor fit`.

        Args:
            detector: the model file that it must have been fitted for; not checked unless given.

        Raises:
            PaveTwinError: it cannot be read, is damaged or of another version, or was fitted for another detector.
        """
        model = cls._parsed(path)
        if detector is not None and file_sha256(detector) != model.detector.sha256:
            raise PaveTwinError(
                f"'{path}' was fitted for another detector than '{detector}': one with the SHA-256 "
                f"{model.detector.sha256[:12]}…; fit it again: pavetwin sensor fit MISSIONS model={detector}."
            )
        return model

    @classmethod
    def _parsed(cls, path: Path) -> Self:
        again = "write it again with `pavetwin sensor fit`"
        try:
            content: Any = json.loads(path.read_bytes())
        except OSError as error:
            raise PaveTwinError(f"Cannot read '{path}': {error.strerror or error}.") from error
        except ValueError as error:
            raise PaveTwinError(f"'{path}' is not a fitted sensor: it is not JSON ({error}); {again}.") from error
        if not isinstance(content, dict) or "pavetwin_sensor" not in content:
            raise PaveTwinError(f"'{path}' is not a fitted sensor: it has no `pavetwin_sensor`; {again}.")
        check_format(content["pavetwin_sensor"], f"The fitted sensor '{path}'")
        try:
            return cls.parse(content, where=f"'{path}'")
        except PaveTwinError as error:
            raise PaveTwinError(f"{str(error).removesuffix('.')}; {again}.") from error


def term_names(classes: Sequence[str]) -> list[str]:
    """The terms of a model over these classes, in order."""
    own = [term for kind in classes for term in (kind, *(f"{kind}:{name}" for name in (*OF_CLASS, BEND)))]
    return [*own, *OF_ALL]


FOLDER: Final = Path(__file__).parent / "fitted"

DEFAULT: Final = shipped.DEFAULT
"""Where no fitted sensor is named: that of the detector which looks where none is named."""


def shipped_sensors() -> list[str]:
    """Their names."""
    return sorted(file.stem for file in FOLDER.glob("*.json"))


def sensor_of(detector: str) -> Path | None:
    """The file of the sensor that ships and was fitted to a detector; None where there is none.

    Args:
        detector: SHA-256 of its model file.
    """
    return next((file for name in shipped_sensors() if _is_of(file := FOLDER / f"{name}.json", detector)), None)


def _is_of(file: Path, detector: str) -> bool:
    return bool(json.loads(file.read_bytes())["detector"]["sha256"] == detector)


def sensor_path(fitted: str | Path) -> Path:
    """The file of a fitted sensor: a JSON file, or one that ships, by name. A file comes first.

    Raises:
        PaveTwinError: there is neither.
    """
    file = Path(fitted)
    if file.is_file():
        return file
    if str(fitted) in shipped_sensors():
        return FOLDER / f"{fitted}.json"
    raise PaveTwinError(
        f"There is no fitted sensor '{fitted}': name one that ships ({', '.join(shipped_sensors())}), or a file of "
        f"`pavetwin sensor fit MISSIONS --output sensor.json`."
    )

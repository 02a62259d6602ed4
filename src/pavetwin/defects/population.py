"""A damage population: how many defects of which classes streets have, how large they are, and where they lie.

A population is a YAML file of the form of `Population`. `survey` and `paper` ship with the package.

The number of defects of a class on a segment is a Poisson number (a log-Gaussian Cox process over segments). With r,
the condition of a segment relative to the mean (lognormal with mean 1, one factor for its street and one for itself),
its mean is D · m · r^(1+g) / E[r^(1+g)], where D is the population's density, m the class's share and g its `growth`:
on average the shares hold, and classes that grow are more frequent where the pavement is worn.

Sizes may grow with the condition too. Half of the defects of a class lie where r > r̃ = exp(σ² (1/2 + g)), with σ² the
variance of ln r; the median of a size is multiplied by (r / r̃)^k, with k its `growth`. Over all defects it holds.
"""

import json
import math
import zlib
from collections.abc import Iterator, Mapping
from functools import cache
from hashlib import sha256
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field, model_validator

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import NUMBER, PlacedValueError, Positive, Settings, Share, Title, Weight
from pavetwin.defects.context import STRAIGHT, CrackContext
from pavetwin.defects.poses import Poses, Position, RoadSection, positioned
from pavetwin.defects.registry import DEFECT_CLASSES, DefectKind, kinds
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Segment, ShapeParameters
from pavetwin.world.pavement_joints import has_slabs
from pavetwin.world.segments import segment_key

Spread = Annotated[float, Field(ge=0, le=3), NUMBER]

_WITHIN: Final = 3
"""Key of the random number under the seed of a shape that decides within what it lies; `context` has two more."""

_STREETS: Final = 1
"""Key of the random numbers that all segments of a street share; those of a segment have no second key."""


Shares = tuple[tuple[DefectKind, float], ...]
"""Classes with their shares of all defects, which sum to 1."""


class DefectDensity(Settings):
    """Number of defects: either `per_segment`, or `per_100_m2` and how it varies."""

    per_segment: Annotated[float, Field(ge=0, le=1000), NUMBER] | None = None
    """Defects on every segment, rounded."""
    per_100_m2: Annotated[float, Field(ge=0, le=100), NUMBER] | None = None
    """Mean number of defects per 100 m² over all streets."""
    street_sigma: Spread = 0.0
    """Standard deviation of the natural logarithm of the density between streets."""
    segment_sigma: Spread = 0.0
    """Spread between the segments of one street."""

    @property
    def varies(self) -> bool:
        """Whether some segments have more than others of their area."""
        return self.per_segment is None and self.variance > 0

    @property
    def variance(self) -> float:
        """Spread of the natural logarithm of the density, over all segments."""
        return self.street_sigma**2 + self.segment_sigma**2

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.per_segment is None) == (self.per_100_m2 is None):
            raise ValueError("give either per_segment or per_100_m2")
        if self.per_segment is not None and (self.street_sigma or self.segment_sigma):
            raise ValueError(
                "per_segment is the same number everywhere; street_sigma and segment_sigma need per_100_m2"
            )
        return self


class Size(Settings):
    """A lognormal size of defects, cut off at both ends."""

    median: Positive
    """Median, between `least` and `most`; with `times`, the product of the medians lies there."""
    sigma: Spread = 0.0
    """Standard deviation of the natural logarithm."""
    least: Positive
    """Lower limit: smaller draws are raised to it."""
    most: Positive
    """Upper limit: larger draws are lowered to it."""
    growth: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.0
    """Exponent by which the median grows with the density of the segment."""
    times: tuple[str, ...] = ()
    """Sizes named earlier that multiply this one; `least` and `most` then bound the product."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.least > self.most:
            raise ValueError(f"least {self.least:g} is larger than most {self.most:g}")
        if not self.times:
            self.contains(self.median)
        return self

    def contains(self, median: float) -> None:
        """Refuse a median outside the limits, since few draws would lie within them.

        Raises:
            PlacedValueError: the median lies outside.
        """
        if not self.least <= median <= self.most:
            product = (
                f"median {self.median:g} times the medians of {' and '.join(self.times)} is " if self.times else ""
            )
            raise PlacedValueError(
                ("median",), f"{product}{median:g}, outside least {self.least:g} and most {self.most:g}"
            )

    def draw(self, rng: np.random.Generator, before: Mapping[str, float], worn: float = 1.0) -> float:
        """A size.

        Args:
            before: those drawn before it, by name.
            worn: the condition of the segment, as `Population.worn` has it.
        """
        factor = math.prod(before[name] for name in self.times) * math.pow(worn, self.growth)
        value = factor * self.median * math.exp(self.sigma * float(rng.standard_normal()))
        return min(self.most, max(self.least, value))


class Beside(Settings):
    """Distances of defects to others on the same segment; normally distributed around their middle."""

    share: Share
    """Share of the defects of the class."""
    along_m: Annotated[float, Field(gt=0, le=100), NUMBER]
    """Standard deviation of the distance along the street."""
    across_m: Annotated[float, Field(gt=0, le=50), NUMBER] | None = None
    """Standard deviation of the distance across it, in the nearest free place; without it, `positions` decides."""


class ClassPopulation(Settings):
    """The defects of one class."""

    weight: Weight
    """Share of all defects, relative to the weights of the other classes."""
    growth: Annotated[float, Field(ge=0, le=2), NUMBER] = 0.0
    """Exponent by which the share of the class grows with the density of the segment."""
    sizes: Mapping[str, Size] = Field(default_factory=dict)
    """Parameters drawn from the population instead of the class's own ranges."""
    positions: Mapping[Position, Share] = Field(default_factory=dict)
    """Weights of the positions on the road; the class's own without it."""
    near: Mapping[str, Beside] = Field(default_factory=dict)
    """Shares placed near defects of this class or of one listed earlier."""
    within: Mapping[str, Share] = Field(default_factory=dict)
    """Shares placed inside defects of a class listed earlier, which lose the overlapping part."""
    on_slabs: str | None = None
    """Class placed instead on streets of concrete slabs; it must itself be placed on slabs."""
    context: CrackContext | None = None
    """Shares that start at manhole covers and patches, run along trenches and joints, or are overgrown."""

    def parameters(self, rng: np.random.Generator, worn: float = 1.0) -> ShapeParameters:
        """The sizes of one defect, by name; `worn` as `Population.worn` has it."""
        drawn: dict[str, float] = {}
        for name, size in self.sizes.items():
            drawn[name] = float(f"{size.draw(rng, drawn, worn):.4g}")
        return tuple(drawn.items())

    def poses(self, rng: np.random.Generator, kind: DefectKind, road: RoadSection, count: int) -> Poses:
        """Possible poses of one defect, regardless of others."""
        if not self.positions:
            return kind.sample_poses(rng, road, count)
        weights = np.array(list(self.positions.values()))
        index = int(rng.choice(len(weights), p=weights / weights.sum()))
        return positioned(rng, list(self.positions)[index], road, count)

    def neighbour(self, rng: np.random.Generator) -> tuple[str, Beside] | None:
        """Class near which one defect lies, and its distances; None for anywhere."""
        number = float(rng.random())
        for name, near in self.near.items():
            if number < near.share:
                return name, near
            number -= near.share
        return None

    def host(self, seed: int) -> str | None:
        """Class within which a defect is placed if possible; None for anywhere.

        Args:
            seed: of its shape, so that other defects do not depend on this draw.
        """
        number = float(child(seed, Stream.DEFECTS, _WITHIN).random())
        for name, share in self.within.items():
            if number < share:
                return name
            number -= share
        return None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        medians: dict[str, float] = {}
        for name, size in self.sizes.items():
            for factor in size.times:
                if factor not in medians:
                    raise PlacedValueError(("sizes", name, "times"), f"'{factor}' is not listed before it")
            medians[name] = size.median * math.prod(medians[factor] for factor in size.times)
            try:
                size.contains(medians[name])
            except PlacedValueError as error:
                raise PlacedValueError(("sizes", name, *error.place), str(error)) from error
        if self.positions and not sum(self.positions.values()) > 0:
            raise PlacedValueError(("positions",), "the weights sum to 0")
        if sum(each.share for each in self.near.values()) > 1:
            raise PlacedValueError(("near",), "the shares sum to more than 1")
        if sum(self.within.values()) > 1:
            raise PlacedValueError(("within",), "the shares sum to more than 1")
        return self


class Population(Settings):
    """A damage population."""

    title: Title
    """Name in messages and records."""
    density: DefectDensity
    """Number of defects: `per_segment`, or `per_100_m2` and its variation."""
    classes: Mapping[str, ClassPopulation] = Field(default_factory=dict)
    """Classes in the order of placement; without it, all classes with their own weights and sizes."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        try:
            self._check_references()
        except PlacedValueError:
            self._check_names()  # a misspelt class is reported before the others that name it
            raise
        if self.classes and not sum(each.weight for each in self.classes.values()) > 0:
            raise PlacedValueError(("classes",), "the weights sum to 0")
        return self

    def _check_names(self) -> None:
        for name in self.classes:
            try:
                DEFECT_CLASSES.get(name)
            except PaveTwinError as error:
                raise PlacedValueError(("classes", name), str(error)) from error

    def _check_references(self) -> None:
        known: list[str] = []
        for name, of_class in self.classes.items():
            if (instead := of_class.on_slabs) is not None:
                self._check_instead(name, instead)
            for other in of_class.within:
                if other not in known:
                    raise PlacedValueError(
                        ("classes", name, "within", other), f"'{other}' is not listed before it", named=False
                    )
            known.append(name)
            for other in of_class.near:
                if other not in known:
                    raise PlacedValueError(
                        ("classes", name, "near", other), f"'{other}' is not listed before it", named=False
                    )

    def _check_instead(self, name: str, instead: str) -> None:
        place = ("classes", name, "on_slabs")
        if instead not in self.classes:
            raise PlacedValueError(place, f"'{instead}' is not listed")
        if self.classes[instead].on_slabs is not None:
            raise PlacedValueError(place, f"'{instead}' is not placed on slabs itself")

    def check(self) -> None:
        """Refuse what no registered class has.

        Raises:
            PlacedValueError: an unknown class or parameter, or a size that its parameter cannot have.
        """
        self._check_names()
        for name, of_class in self.classes.items():
            kind = DEFECT_CLASSES.get(name)
            for parameter, size in of_class.sizes.items():
                for key, value in (("least", size.least), ("most", size.most)):
                    try:
                        kind.parameters_from(((parameter, value),), where=f"the class '{name}'")
                    except PaveTwinError as error:
                        known = kind.parameters and parameter in kind.parameters.model_fields
                        place = ("classes", name, "sizes", parameter, *((key,) if known else ()))
                        raise PlacedValueError(place, str(error)) from error
            if of_class.context is not None:
                self._check_context(kind, of_class.context, "classes", name, "context")

    def _check_context(self, kind: DefectKind, context: CrackContext, *place: str) -> None:
        names = kind.parameters.model_fields if kind.parameters else {}
        if context.along_joints and not all(key in names for key, _ in STRAIGHT):
            raise PlacedValueError(
                place,
                "`slab_joint`, `slab_corner` and `lane_joint` need a class with the parameters "
                f"{' and '.join(key for key, _ in STRAIGHT)}; '{kind.name}' has none",
            )
        if context.overgrown and "overgrown" not in names:
            raise PlacedValueError((*place, "overgrown"), f"the class '{kind.name}' has no parameter overgrown")

    def of_class(self, name: str) -> ClassPopulation:
        """The defects of a class; of one that it does not list, as the class itself has them."""
        return self.classes.get(name, _UNLISTED)

    def kinds_on(self, segment: Segment, shares: Shares, seed: int, rng: np.random.Generator) -> Iterator[DefectKind]:
        """The class of each defect to place on a segment, in the order in which they are placed.

        Args:
            shares: those of this population.
        """
        if self.density.varies:
            mean = float(self.density.per_100_m2 or 0.0) * segment.area_m2 / 100
            condition, variance = self._condition(segment, seed), self.density.variance
            for kind, share in shares:
                power = 1 + self.of_class(kind.name).growth
                relative = condition**power / math.exp(variance * power * (power - 1) / 2)
                for _ in range(int(rng.poisson(mean * share * relative))):
                    yield kind
            return
        weights = np.array([share for _, share in shares])
        for _ in range(self._count_on(segment, rng)):
            yield shares[int(rng.choice(len(shares), p=weights))][0]

    def kind_on(self, street: str, kind: DefectKind) -> DefectKind:
        """The class placed on the street of this name instead of a drawn class."""
        instead = self.of_class(kind.name).on_slabs
        if instead is None or instead not in self.classes or not has_slabs(street):
            return kind
        return DEFECT_CLASSES.get(instead)

    def worn(self, name: str, segment: Segment, seed: int) -> float:
        """The condition of a segment relative to the one that half of the defects of a class lie beyond."""
        if not self.density.varies:
            return 1.0
        return self._condition(segment, seed) / math.exp(self.density.variance * (0.5 + self.of_class(name).growth))

    def _count_on(self, segment: Segment, rng: np.random.Generator) -> int:
        """Equal density everywhere, by segment or by area; numbers by area are rounded at random, unbiased."""
        if self.density.per_segment is not None:
            return round(self.density.per_segment)
        return math.floor(float(self.density.per_100_m2 or 0.0) * segment.area_m2 / 100 + float(rng.random()))

    def shares(self) -> Shares:
        """Each class with its share of all defects, in the order in which they are placed."""
        if not self.classes:
            found = [(kind, kind.weight) for kind in kinds()]
        else:
            found = [(DEFECT_CLASSES.get(name), each.weight) for name, each in self.classes.items()]
        weights = np.array([weight for _, weight in found])
        shares = weights / weights.sum()
        return tuple((kind, float(share)) for (kind, _), share in zip(found, shares, strict=True))

    def _condition(self, segment: Segment, seed: int) -> float:
        """The density of a segment relative to the mean; lognormal, its mean over streets and segments is 1."""
        street = child(seed, Stream.DEFECTS, zlib.crc32(segment.street.encode()), _STREETS)
        own = child(seed, Stream.DEFECTS, segment_key(segment), _STREETS + 1)
        exponent = 0.0
        for rng, sigma in ((street, self.density.street_sigma), (own, self.density.segment_sigma)):
            exponent += sigma * float(rng.standard_normal()) - sigma**2 / 2
        return math.exp(exponent)


_UNLISTED: Final = ClassPopulation(weight=0.0)


def population_names() -> list[str]:
    """The populations that ship with the package."""
    return names_in("pavetwin.defects", "populations")


def population_sha256(name: str) -> str:
    """SHA-256 of the contents of a population.

    Raises:
        PaveTwinError: there is no such population or file, or the file is none.
    """
    return sha256(json.dumps(population(name).model_dump(mode="json")).encode()).hexdigest()


@cache
def population(name: str) -> Population:
    """The population of a name, or of a YAML file of the user's own.

    Raises:
        PaveTwinError: there is no such population or file, or the file is none.
    """
    return read_named(
        Population,
        name,
        what="damage population",
        key="population",
        package="pavetwin.defects",
        folder="populations",
        check=Population.check,
    )

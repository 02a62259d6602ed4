"""Synthetic images made to look like photographs, switch by switch: each a `Photometric` of views.

What is needed of a photograph is measured once, when it is first drawn.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
from PIL import Image

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer.amplitude import half_block, low_frequencies, with_amplitudes
from pavetwin.training.trainer.appearance import Appearance, appearance_of, moved_to
from pavetwin.training.trainer.augment import Photometric
from pavetwin.training.trainer.options import TrainingOptions

Measure = TypeVar("Measure")


def photometrics(photographs: ExampleSet | None, options: TrainingOptions) -> tuple[Photometric, ...]:
    """What the options say is done to synthetic images.

    Args:
        photographs: None only where the options need none.
    """
    changes: list[Photometric] = []
    if photographs is None:
        return ()
    if options.appearance:
        changes.append(AppearanceChange(photographs, options))
    if options.fourier:
        changes.append(AmplitudeChange(photographs, options))
    return tuple(changes)


class References(Generic[Measure]):
    """A measure of photographs, drawn at random."""

    def __init__(
        self, photographs: ExampleSet, options: TrainingOptions, measure: Callable[[UInt8Array], Measure]
    ) -> None:
        self._photographs, self._measure = photographs, measure
        self._size_px, self._native = options.image_px, options.native
        self._known: dict[int, Measure] = {}

    def draw(self, rng: np.random.Generator) -> Measure:
        """Of one photograph.

        Raises:
            PaveTwinError: its picture cannot be read.
        """
        at = int(rng.integers(len(self._photographs.examples)))
        if at not in self._known:
            self._known[at] = self._measure(self._shown(at))
        return self._known[at]

    def _shown(self, at: int) -> UInt8Array:
        """At the resolution at which the network sees it: its middle, or all of it, scaled."""
        picture = self._photographs.picture(self._photographs.examples[at])
        width, height = picture.size
        side = self._size_px
        if self._native and max(width, height) > side:
            left, top = (max(0, (length - side) // 2) for length in (width, height))
            return np.asarray(picture.crop((left, top, min(width, left + side), min(height, top + side))))
        scale = side / max(width, height)
        size = (max(1, round(scale * width)), max(1, round(scale * height)))
        return np.asarray(picture.resize(size, Image.Resampling.BILINEAR))


class AmplitudeChange:
    """Low frequencies with the amplitudes of a photograph."""

    def __init__(self, photographs: ExampleSet, options: TrainingOptions) -> None:
        self._beta = options.fourier
        most = half_block((options.image_px, options.image_px), options.fourier)

        def amplitudes(pixels: UInt8Array) -> Float64Array:
            return np.abs(low_frequencies(pixels, min(most, (min(pixels.shape[:2]) - 1) // 2)))

        self._references: References[Float64Array] = References(photographs, options, amplitudes)

    def __call__(self, pixels: UInt8Array, rng: np.random.Generator) -> UInt8Array:
        """Of one synthetic image."""
        return with_amplitudes(pixels, self._references.draw(rng), self._beta)


class AppearanceChange:
    """Colours, sharpness and noise of a photograph, for a share of the images."""

    def __init__(self, photographs: ExampleSet, options: TrainingOptions) -> None:
        self._share = options.appearance
        self._references: References[Appearance] = References(photographs, options, appearance_of)

    def __call__(self, pixels: UInt8Array, rng: np.random.Generator) -> UInt8Array:
        """Of one synthetic image."""
        return moved_to(pixels, self._references.draw(rng), rng) if rng.random() < self._share else pixels

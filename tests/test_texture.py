"""Texture statistics of pictures whose statistics are known, and the classifier's AUC and interval of known tables."""

from pathlib import Path

import numpy as np
import pytest
from gallery.scenes import scenes_of
from gallery.texture import GROUPS, RINGS, SIDE_PX, texture_statistics, told_apart
from PIL import Image

AT = np.arange(SIDE_PX)


def picture(field: np.ndarray) -> Image.Image:
    return Image.fromarray(np.clip(field, 0, 255).astype(np.uint8))


def grating(period_px: float, *, upright: bool = True) -> Image.Image:
    wave = 128 + 100 * np.sin(2 * np.pi * AT / period_px)
    return picture(np.tile(wave, (SIDE_PX, 1)) if upright else np.tile(wave[:, None], (1, SIDE_PX)))


def of(name: str, image: Image.Image) -> np.ndarray:
    return texture_statistics(image)[GROUPS[name]]


def test_an_even_picture_has_one_pattern() -> None:
    """No neighbour is darker than the middle: all eight are at least as bright."""
    assert of("patterns at 1 pixel", picture(np.full((SIDE_PX, SIDE_PX), 90.0))) == pytest.approx([0] * 8 + [1, 0])


def test_patterns_of_a_ramp_are_those_of_an_edge() -> None:
    """Three neighbours are darker, five at least as bright."""
    ramp = np.tile(AT // 2, (SIDE_PX, 1))
    shares = of("patterns at 2 pixels", picture(ramp))
    assert shares[5] == pytest.approx(1.0)


def test_patterns_of_noise_are_those_of_chance() -> None:
    """Of nine independent values each is the largest with probability 1/9; the same of the smallest."""
    shares = of("patterns at 1 pixel", picture(np.random.default_rng(1).uniform(0, 255.99, (SIDE_PX, SIDE_PX))))
    assert shares[0] == pytest.approx(1 / 9, abs=0.005)
    assert shares[8] == pytest.approx(1 / 9, abs=0.005)
    assert shares.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("upright", [True, False])
@pytest.mark.parametrize("period_px", [4, 16, 64])
def test_the_spectrum_of_a_grating_peaks_at_its_frequency(period_px: int, upright: bool) -> None:
    level = of("spectrum", grating(period_px, upright=upright))
    borders = np.geomspace(2 / SIDE_PX, 0.5, RINGS + 1)
    assert int(np.argmax(level)) == int(np.digitize(1 / period_px, borders)) - 1


def test_a_grating_has_a_direction_and_noise_has_none() -> None:
    noise = picture(np.random.default_rng(2).normal(128, 30, (SIDE_PX, SIDE_PX)))
    fine = slice(RINGS // 2, RINGS)
    assert of("its spread over directions", noise)[fine].max() < 0.25
    assert of("its spread over directions", grating(8)).max() > 2.0


def tables(apart: float, rows: int, columns: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (rows, columns)), rng.normal(apart, 1, (rows, columns))


def test_what_is_alike_is_not_told_apart() -> None:
    held = 0
    for seed in range(12):
        auc, low, high = told_apart(*tables(0.0, 30, 4, seed), resamples=40)
        assert low <= auc <= high
        held += low <= 0.5 <= high
    assert held >= 10


def test_what_differs_by_a_known_distance_has_the_auc_of_that_distance() -> None:
    """Of two normal distributions d standard deviations apart it is Φ(d / √2)."""
    auc, low, high = told_apart(*tables(1.0, 300, 1, 3), resamples=40)
    assert low < 0.7602 < high
    assert auc == pytest.approx(0.7602, abs=0.04)
    assert 0.05 < high - low < 0.12


def test_what_never_overlaps_is_always_told_apart() -> None:
    auc, low, high = told_apart(*tables(30.0, 25, 3, 4), resamples=20)
    assert (auc, low, high) == pytest.approx((1.0, 1.0, 1.0))


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_lies_about_the_auc_where_resamples_tell_less(seed: int) -> None:
    """Noise, each picture there twice: whose twin a classifier knows is told apart, and a resample lacks many twins."""
    rng = np.random.default_rng(seed)
    ours, real = (np.repeat(rng.normal(0, 1, (20, 40)), 2, axis=0) + rng.normal(0, 0.02, (40, 40)) for _ in range(2))
    auc, low, high = told_apart(ours, real, resamples=30)
    assert auc > 0.9
    assert low < auc <= high


def test_photographs_of_few_scenes_say_less() -> None:
    """Twelve scenes of ten pictures each that are nearly the same: the interval is that of twelve, not of 120."""
    rng = np.random.default_rng(5)
    scenes = np.repeat(np.arange(12), 10)
    real = rng.normal(0.7, 1, (12, 3))[scenes] + rng.normal(0, 0.05, (120, 3))
    ours = rng.normal(0, 1, (120, 3))
    alone, together = (told_apart(ours, real, scenes=known, resamples=40) for known in (None, scenes.tolist()))
    assert together[2] - together[1] > 1.5 * (alone[2] - alone[1])
    assert together[0] < alone[0], "a classifier knows a place that it was fitted to"


def test_overlapping_photographs_are_one_scene(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    paths = []
    for place in range(2):
        large = np.kron(rng.integers(40, 216, (150, 150)), np.ones((6, 6)))
        for left in (0, 90):
            path = tmp_path / f"{place}-{left}.png"
            picture(large[:SIDE_PX, left : left + SIDE_PX]).convert("RGB").save(path)
            paths.append(path)
    first, second, third, fourth = scenes_of(paths)
    assert first == second != third == fourth

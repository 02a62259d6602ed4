"""How many entries are doubled or joined wrongly, and how far off they lie, on a simulated street."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from shapely import Polygon

from pavetwin.detections import Detections
from scenes.observed import entry_of, merged, observed


@dataclass(frozen=True)
class Accuracy:
    doubled: float
    """Share of entries beyond one a defect."""
    joined: float
    """Share of entries that hold several defects."""
    median_m: float
    """Of the distances between entry and defect."""


def street(noise_m: float, stated_m: float, defects: int = 200, apart_m: float = 3.0) -> Accuracy:
    """A defect of three classes every `apart_m` on average, 8 m wide; images every 3.5 m that reach 5 m ahead and back;
    four in five defects are reported in each, their outlines wrong by 4 cm and a tenth of their size. `noise_m` is the
    error of each image's position, and `stated_m` what is stated of it."""
    rng = np.random.default_rng(0)
    kinds = rng.choice(["pothole", "single_crack", "Crocodile Crack"], defects)
    places = np.column_stack([np.sort(rng.uniform(0, apart_m * defects, defects)), rng.uniform(-4, 4, defects)])
    sizes = rng.uniform(0.3, 1.2, (defects, 2))
    looks: list[Detections] = []
    truth: list[int] = []
    for image, x_m in enumerate(np.arange(0, apart_m * defects, 3.5)):
        off = rng.normal(0, noise_m, 2)
        for number in np.flatnonzero(np.abs(places[:, 0] - x_m) < 5):
            if rng.random() < 0.8:
                middle = places[number] + off + rng.normal(0, 0.04, 2)
                half = sizes[number] * rng.uniform(0.9, 1.1, 2) / 2
                shape = shapely.box(*(middle - half), *(middle + half))
                assert isinstance(shape, Polygon)
                kind, sure = str(kinds[number]), float(rng.uniform(0.3, 0.95))
                looks.append(observed(kind, sure, f"{image}", shape, pixel_m=0.02, position_error_m=stated_m))
                truth.append(int(number))
    groups = merged(looks)
    of = [sorted({truth[index] for index in group}) for group in groups]
    away = []
    for group, numbers in zip(groups, of, strict=True):
        place = entry_of(1, [looks[index] for index in group]).place
        assert place is not None
        away.append(np.hypot(*(places[numbers[0]] - (place.x, place.y))))
    doubled = sum(len(numbers) for numbers in of) - len(set(truth))
    return Accuracy(doubled / len(groups), sum(len(each) > 1 for each in of) / len(groups), float(np.median(away)))


def test_without_noise_every_defect_is_one_entry_at_its_place() -> None:
    found = street(0.0, 0.0)
    assert found.doubled <= 0.01
    assert found.joined <= 0.01
    assert found.median_m < 0.05


@pytest.mark.parametrize(("noise_m", "joined", "median_m"), [(0.02, 0.01, 0.05), (0.3, 0.02, 0.35)])
def test_with_a_stated_error_few_are_doubled_or_joined_wrongly(noise_m: float, joined: float, median_m: float) -> None:
    found = street(noise_m, noise_m)
    assert found.doubled <= 0.03
    assert found.joined <= joined
    assert found.median_m < median_m


def test_an_error_that_is_not_stated_doubles_entries() -> None:
    assert street(1.0, 0.0).doubled > 2 * street(1.0, 1.0).doubled

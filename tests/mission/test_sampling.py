"""A defect is sampled when its segment is first inspected, and once: a town has thousands of them."""

from collections import Counter

import numpy as np
import pytest

from pavetwin.defects import sample_points
from pavetwin.errors import PaveTwinError
from pavetwin.mission import environment
from pavetwin.mission.fly import fly_over
from pavetwin.world.model import Defect
from scenes import tiny


def test_only_defects_of_inspected_segments_are_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    streets = (tiny.street("street", (0.0, 0.0), (60.0, 0.0)), tiny.street("far", (60.0, 0.0), (120.0, 0.0)))
    defects = (tiny.defect(0, 20.0, 0.0), tiny.defect(1, 100.0, 0.0, "far"), tiny.defect(2, 40.0, 0.0))
    scene = tiny.Scene(tiny.world(streets, defects))
    settings = scene.settings()
    prepared = scene.environment(settings)
    asked = Counter[int]()

    def counted(defect: Defect) -> np.ndarray:
        asked[defect.id] += 1
        return sample_points(defect)

    monkeypatch.setattr(environment, "sample_points", counted)
    for targets, expected in (([0], {0: 1, 2: 1}), ([0], {0: 1, 2: 1}), ([1, 0], {0: 1, 1: 1, 2: 1})):
        result = fly_over(prepared, scene.traffic(), settings, targets, "skip")
        assert sum(row.confirmed for row in result.rows) == len(expected)
        assert asked == expected


def test_a_failure_in_sampling_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tiny.empty_street((30.0, 0.0))
    prepared = scene.environment()

    def fail(_: Defect) -> np.ndarray:
        raise ValueError("no triangles")

    monkeypatch.setattr(environment, "sample_points", fail)
    with pytest.raises(ValueError, match="no triangles"):
        fly_over(prepared, scene.traffic(), scene.settings(), [0], "baseline")
    monkeypatch.setattr(environment, "sample_points", lambda _: np.empty((0, 2)))
    with pytest.raises(PaveTwinError, match="defect 0 has no sample points"):
        fly_over(prepared, scene.traffic(), scene.settings(), [0], "baseline")

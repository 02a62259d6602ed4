"""The detectors that ship: they are found by name, open without PyTorch, and see what they were trained to see."""

from pathlib import Path

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import area
from pavetwin.perception.detector import Detector
from pavetwin.perception.model_file import DEFAULT, model_path, open_session, shipped_models
from pavetwin.perception.suppression import areas, shared_areas
from pavetwin.training.evaluation.comparison import timed_picture
from scenes.drawn_detector import FILE

MOST_BYTES = 15_000_000

LICENCES = {
    "photographs": "Apache-2.0; trained on photographs of RDD2022 (Arya et al. 2022), whose terms are stated there: "
    "cite it",
    "rendered": "Apache-2.0",
}
"""Licence in each file; it names the photographs of the training."""

POTHOLES = ((76, 81, 176, 183), (465, 88, 534, 157))
CRACK = (247, 0, 327, 480)
"""Where they are on `timed_picture`, in pixels."""


def test_a_file_comes_before_a_name_and_what_is_neither_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert DEFAULT in shipped_models()
    assert model_path(DEFAULT) != model_path(FILE) == FILE
    monkeypatch.chdir(tmp_path)
    Path(DEFAULT).write_bytes(b"mine")
    assert model_path(DEFAULT) == Path(DEFAULT)
    with pytest.raises(
        PaveTwinError, match=rf"There is no model 'synthetic': name one that ships \(.*{DEFAULT}.*\), or"
    ):
        model_path("synthetic")


@pytest.mark.parametrize("name", shipped_models())
def test_a_shipped_model_states_its_recipe_and_licence_and_is_small(name: str) -> None:
    file = model_path(name)
    assert file.stat().st_size <= MOST_BYTES
    _, facts = open_session(file, 1)
    assert facts.licence == LICENCES[name]
    assert len(facts.recipe) == 64
    assert facts.mask_px
    assert Detector(name, threads=1).facts == facts


@pytest.mark.parametrize("name", shipped_models())
def test_a_shipped_model_finds_potholes_and_the_crack_of_a_drawn_pavement(name: str) -> None:
    """Exchanged or damaged weights would not; `compare` times the heads of regions on the same image."""
    (found,) = Detector(name, threads=1).detect([timed_picture()])
    assert len(found) >= 2
    (found,) = Detector(name, confidence=0.1, threads=1).detect([timed_picture()])
    assert {*found.class_name} == {"pothole", "single_crack"}
    for what, box in (*(("pothole", each) for each in POTHOLES), ("single_crack", CRACK)):
        said = found.box_px[found.class_name == what]
        shared = shared_areas(np.array([box], dtype=float), said)[0]
        assert (shared / (area(box) + areas(said) - shared)).max() > 0.7

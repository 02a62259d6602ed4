"""The detectors that ship: they are found by name, open without PyTorch, and see what they were trained to see."""

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import area
from pavetwin.perception.box_pairs import areas, shared_areas
from pavetwin.perception.inference import Detector
from pavetwin.perception.inference.model_file import open_session
from pavetwin.perception.shipped import DEFAULT, model_path, shipped_models
from pavetwin.training.evaluation.comparison import timed_picture
from scenes.drawn_detector import FILE

ROOT = Path(__file__).resolve().parents[2]
MOST_BYTES = 15_000_000

LICENCES = {
    "mixed-3": "Apache-2.0; trained on photographs of RDD2022 (Arya et al. 2022), whose terms are stated there: "
    "cite it",
    "synthetic-1": "Apache-2.0",
    "synthetic-5": "Apache-2.0",
    "synthetic-8": "Apache-2.0",
    "synthetic-11": "Apache-2.0",
    "synthetic-12": "Apache-2.0",
}
"""What each file says; whoever saw photographs names them."""

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
def test_what_ships_says_its_recipe_and_licence_and_is_small(name: str) -> None:
    file = model_path(name)
    assert file.stat().st_size <= MOST_BYTES
    _, facts = open_session(file, 1)
    assert facts.licence == LICENCES[name]
    settings = sorted((ROOT / "recipes" / "runs" / name).rglob("run.json"))
    assert facts.recipe == sha256(b"".join(each.read_bytes() for each in settings)).hexdigest()
    assert facts.mask_px
    assert Detector(name, threads=1).facts == facts


@pytest.mark.parametrize("name", shipped_models())
def test_what_ships_finds_potholes_and_the_crack_of_a_drawn_pavement(name: str) -> None:
    """Weights that were exchanged or ruined do not; and heads of regions take time where `compare` measures it."""
    (found,) = Detector(name, threads=1).detect([timed_picture()])
    assert len(found) >= 2
    (found,) = Detector(name, confidence=0.1, threads=1).detect([timed_picture()])
    assert set(found.names) == {"Pothole", "Single Crack"}
    for what, box in (*(("Pothole", each) for each in POTHOLES), ("Single Crack", CRACK)):
        said = found.boxes[np.array(found.names) == what].astype(float)
        shared = shared_areas(np.array([box], dtype=float), said)[0]
        assert (shared / (area(box) + areas(said) - shared)).max() > 0.7

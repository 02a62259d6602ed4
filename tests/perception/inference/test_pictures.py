"""Pictures of any size as pixels."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.perception import images as pictures
from pavetwin.perception.images import opened, pixels_of


@pytest.fixture(scope="module")
def orthophoto(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of 200 million pixels, more than Pillow takes unless told otherwise."""
    file = tmp_path_factory.mktemp("pictures") / "orthophoto.png"
    Image.new("1", (20_000, 10_000)).save(file)
    return file


def test_an_orthophoto_is_opened_without_a_warning_and_pillow_s_limit_stays(orthophoto: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with opened(orthophoto) as held:
            assert held.size == (20_000, 10_000)
    with pytest.raises(Image.DecompressionBombError):
        Image.open(orthophoto)


def test_what_is_larger_still_is_refused_before_its_pixels_are_read(
    orthophoto: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pictures, "LARGEST_PX", 199_000_000)
    with pytest.raises(PaveTwinError, match=r"has 20000 × 10000 pixels; at most 199 million are read, so cut it up\.$"):
        pixels_of(orthophoto)


@pytest.mark.parametrize("array", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)])
def test_an_array_that_is_no_picture_is_refused(array: np.ndarray) -> None:
    with pytest.raises(PaveTwinError, match="red, green, blue"):
        pixels_of(array)

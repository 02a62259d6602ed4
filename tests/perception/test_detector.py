"""A detector from its file alone: what it finds, on which images, and which files it refuses."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError
from pavetwin.perception.detector import WHOLE, Detector
from scenes.drawn_detector import FILE, ROAD, SIDE_PX, drawn

STREET = drawn((SIDE_PX, 64), ("pothole", (10, 8, 40, 48)), ("car", (60, 12, 90, 56)))
CRACKS = drawn((SIDE_PX, 64), ("single_crack", (6, 4, 26, 60)), ("crocodile_crack", (40, 10, 88, 50)))
SIDEWALK = drawn((SIDE_PX, 64), ("person", (30, 8, 54, 60)))


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector(FILE, threads=1)


def same(one: Detections, other: Detections) -> bool:
    return one.without("mask") == other.without("mask") and one.size_px == other.size_px


def test_it_finds_what_was_drawn(detector: Detector) -> None:
    """Edges to the pixel, classes, both confidences, the most confident first, and masks of defects alone."""
    street, cracks, sidewalk = detector.detect([STREET, CRACKS, SIDEWALK])
    assert [*street.class_name] == ["car", "pothole"]
    np.testing.assert_allclose(street.box_px, [[60, 12, 90, 56], [10, 8, 40, 48]], atol=0.01)
    assert sorted([*cracks.class_name]) == ["crocodile_crack", "single_crack"]
    assert [*sidewalk.class_name] == ["person"]
    assert (street.subtype_confidence[0], street.detection_confidence[0] > 0.7) == (1.0, True)
    np.testing.assert_allclose(cracks.confidence, cracks.detection_confidence * cracks.subtype_confidence)
    assert 0.8 < cracks.subtype_confidence.min() < cracks.subtype_confidence.max() < 0.99
    assert street.mask_pixels(0) is None
    window_and_mask = street.mask_pixels(1)
    assert window_and_mask is not None
    assert window_and_mask[0] == (10, 8, 40, 48)
    assert window_and_mask[1].mean() > 0.95


def test_the_same_images_give_the_same_alone_and_together(detector: Detector, tmp_path: Path) -> None:
    images = [STREET, CRACKS, SIDEWALK]
    for at, image in enumerate(images):
        image.save(tmp_path / f"{at}.png")
    together = detector.detect(images)
    alone = [detector.detect([tmp_path / f"{at}.png"])[0] for at in range(3)]
    assert all(map(same, together, alone))
    assert detector.detect([]) == []


def test_images_of_every_shape_and_kind_are_taken(detector: Detector) -> None:
    wide = Image.new("RGB", (3 * SIDE_PX, 40), ROAD)
    kinds = [wide, Image.new("RGB", (1, 1)), STREET.convert("L"), STREET.convert("RGBA"), CRACKS.convert("P")]
    found = detector.detect(kinds)
    assert [each.size_px for each in found] == [kind.size for kind in kinds]
    assert same(found[3], detector.detect([STREET])[0])
    assert "pothole" in [*found[2].class_name]
    for each in found:
        assert (each.box_px >= 0).all()
        assert (each.box_px <= np.array([*each.size_px, *each.size_px])).all()


def test_tiles_find_what_the_whole_shows_also_across_seams() -> None:
    """Things much larger than a tile, on its seams, and within it: once each, as a look at all of it gives them."""
    things = (
        ("crocodile_crack", (30, 20, 190, 60)),
        ("single_crack", (210, 70, 235, 220)),
        ("pothole", (60, 85, 100, 125)),
        ("car", (120, 150, 180, 190)),
    )
    sheet = drawn((288, 256), *things)
    (whole,) = Detector(FILE, tiled=False, image_px=288, threads=1).detect([sheet])
    (tiled,) = Detector(FILE, tiled=True, threads=1).detect([sheet])
    for found in (whole, tiled):
        told = sorted(zip([*found.class_name], np.round(found.box_px).astype(int).tolist(), strict=True))
        assert told == sorted((name, list(box)) for name, box in things)
        crack = found.mask_pixels([*found.class_name].index("single_crack"))
        assert crack is not None
        assert crack[1].mean() > 0.9


def test_an_overview_finds_what_tiles_do_not_and_nothing_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    things = (("crocodile_crack", (30, 20, 190, 60)), ("pothole", (60, 85, 100, 125)), ("car", (120, 150, 180, 190)))
    sheet = drawn((288, 256), *things)
    both = Detector(FILE, overview=True, threads=1)
    (found,) = both.detect([sheet])
    assert sorted([*found.class_name]) == sorted(name for name, _ in things)
    (whole,) = Detector(FILE, tiled=False, threads=1).detect([sheet])
    nothing = Detector(FILE, tiled=True, confidence=0.9999, threads=1)
    monkeypatch.setattr(both, "_tiles", nothing._tiles)  # as of things that no tile shows well enough
    (seen,) = both.detect([sheet])
    assert same(seen, whole)
    assert len(seen) > 0


def test_an_overview_is_of_larger_images_alone_and_of_none_seen_whole() -> None:
    both, asked = Detector(FILE, overview=True, threads=1), Detector(FILE, tiled=True, threads=1)
    assert both.in_tiles((SIDE_PX + 1, SIDE_PX))
    picture = STREET.resize((SIDE_PX, SIDE_PX))
    assert same(both.detect([picture])[0], asked.detect([picture])[0])
    with pytest.raises(PaveTwinError, match="`overview`"):
        Detector(FILE, overview=True, tiled=False)


def test_images_a_little_larger_than_those_of_training_are_seen_whole_unless_tiles_are_asked_for() -> None:
    native, asked = Detector(FILE, threads=1), Detector(FILE, tiled=True, threads=1)
    native.tiled = True  # as after training on crops
    little, large = (int(WHOLE * SIDE_PX), SIDE_PX), (int(WHOLE * SIDE_PX) + 1, SIDE_PX)
    assert [each.in_tiles(little) for each in (native, asked)] == [False, True]
    assert [each.in_tiles(large) for each in (native, asked)] == [True, True]
    assert not asked.in_tiles((SIDE_PX, SIDE_PX))


def test_detections_become_those_of_supervision(detector: Detector) -> None:
    (found,) = detector.detect([STREET])
    told = found.to_supervision()
    assert told.xyxy.tolist() == found.box_px.tolist()
    assert told.data["class_name"].tolist() == [*found.class_name]
    assert told.mask.shape == (2, 64, SIDE_PX)
    assert found.to_supervision(masks=False).mask is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"confidence": 25}, "`confidence` 25"),
        ({"overlap": 0}, "`overlap` 0"),
        ({"image_px": 100}, "`image_px` 100: a multiple of 32"),
    ],
)
def test_values_out_of_bounds_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        Detector(FILE, **options)


def test_other_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = FILE.read_bytes()
    half, foreign, image = tmp_path / "half.onnx", tmp_path / "foreign.onnx", tmp_path / "a.jpg"
    half.write_bytes(content[: len(content) // 2])
    foreign.write_bytes(content.replace(b"pavetwin_detector", b"another__detector"))
    image.write_text("text")
    with pytest.raises(PaveTwinError, match=r"There is no model '.*gone\.onnx'"):
        Detector(tmp_path / "gone.onnx")
    with pytest.raises(PaveTwinError, match=r"half\.onnx' is damaged, or no ONNX model"):
        Detector(half)
    with pytest.raises(PaveTwinError, match=r"is an ONNX model, but not a detector"):
        Detector(foreign)
    with pytest.raises(PaveTwinError, match=r"a\.jpg' cannot be read as an image"):
        Detector(FILE, threads=1).detect([image])
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(PaveTwinError, match=r"needs onnxruntime.*pip install pavetwin\[detect\]"):
        Detector(FILE)

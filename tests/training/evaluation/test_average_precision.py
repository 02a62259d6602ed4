"""Average precision: cases with known answers, and the published evaluation (pycocotools) on random ones."""

import contextlib
import io

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pavetwin.training.evaluation.average_precision import Scored, average_precision

BOX, FAR = (10.0, 10.0, 50.0, 40.0), (60.0, 60.0, 90.0, 95.0)


def scored(said: list[tuple], true: list[tuple]) -> Scored:
    """Of one image: (box, class, confidence), and (box, class, ignored)."""
    return Scored(
        np.array([box for box, _, _ in said], dtype=np.float64).reshape(-1, 4),
        np.array([number for _, number, _ in said], dtype=np.intp),
        np.array([confidence for _, _, confidence in said], dtype=np.float64),
        np.array([box for box, _, _ in true], dtype=np.float64).reshape(-1, 4),
        np.array([number for _, number, _ in true], dtype=np.intp),
        np.array([ignored for _, _, ignored in true], dtype=np.bool_),
    )


@pytest.mark.parametrize(
    ("said", "true", "expected"),
    [
        ([(BOX, 0, 0.9)], [(BOX, 0, False)], 1.0),
        ([], [(BOX, 0, False)], 0.0),
        ([(BOX, 1, 0.9)], [(BOX, 0, False)], 0.0),
        ([(BOX, 0, 0.9), (BOX, 0, 0.8)], [(BOX, 0, False), (FAR, 0, False)], 51 / 101),
        ([(FAR, 0, 0.9), (BOX, 0, 0.8)], [(BOX, 0, False)], 0.5),
        ([(FAR, 0, 0.9), (BOX, 0, 0.8)], [(BOX, 0, False), (FAR, 0, True)], 1.0),
    ],
    ids=["perfect", "nothing said", "another class", "duplicate", "false alarm first", "an ignored region"],
)
def test_cases_with_known_answers(said: list[tuple], true: list[tuple], expected: float) -> None:
    assert average_precision([scored(said, true)], 2)[0, 0] == pytest.approx(expected)


def test_a_class_without_objects_has_no_value() -> None:
    assert np.isnan(average_precision([scored([(BOX, 1, 0.9)], [(BOX, 0, False)])], 2)[1]).all()


def some_images(rng: np.random.Generator) -> list[Scored]:
    images = []
    for _ in range(12):
        true = []
        for _ in range(int(rng.integers(0, 7))):
            left, top = rng.uniform(0, 80, 2)
            box = (left, top, left + rng.uniform(4, 40), top + rng.uniform(4, 40))
            true.append((box, int(rng.integers(2)), bool(rng.random() < 0.25)))
        said = []
        for box, number, _ in true * 2:
            moved = np.array(box) + rng.normal(0, 3, 4)
            said.append((tuple(moved[:2]) + tuple(np.maximum(moved[2:], moved[:2] + 1)), number, float(rng.random())))
        said += [((0.0, 0.0, *rng.uniform(2, 60, 2)), int(rng.integers(2)), float(rng.random()))]
        images.append(scored(said, true))
    return images


@pytest.mark.parametrize("seed", range(4))
def test_it_agrees_with_the_published_evaluation(seed: int) -> None:
    images = some_images(np.random.default_rng(seed))
    rows, said = [], []
    for at, image in enumerate(images):
        for box, number, ignored in zip(image.true_boxes, image.true_classes, image.ignored, strict=True):
            left, top, right, bottom = box.tolist()
            rows.append(
                {
                    "id": len(rows) + 1,
                    "image_id": at,
                    "category_id": int(number) + 1,
                    "bbox": [left, top, right - left, bottom - top],
                    "area": (right - left) * (bottom - top),
                    "iscrowd": int(ignored),
                }
            )
        for box, number, confidence in zip(image.boxes, image.classes, image.confidence, strict=True):
            left, top, right, bottom = box.tolist()
            said.append(
                {
                    "image_id": at,
                    "category_id": int(number) + 1,
                    "bbox": [left, top, right - left, bottom - top],
                    "score": float(confidence),
                }
            )
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO()
        truth.dataset = {
            "images": [{"id": at} for at in range(len(images))],
            "annotations": rows,
            "categories": [{"id": 1}, {"id": 2}],
        }
        truth.createIndex()
        judge = COCOeval(truth, truth.loadRes(said), "bbox")
        judge.evaluate()
        judge.accumulate()
    expected = judge.eval["precision"][:, :, :, 0, -1].mean(axis=1).T
    assert average_precision(images, 2) == pytest.approx(expected, abs=1e-9)

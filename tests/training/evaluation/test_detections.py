"""Files of detections that are not as described are refused by one line that names the entry."""

from pathlib import Path
from typing import Any

import pytest

from pavetwin.errors import PaveTwinError
from scenes.detections import CAR, CRACK, RUT, said, scene, true

NAN = float("nan")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (said(9, CAR), "is of image 9, which is not in test of the dataset"),
        (said(1, RUT), "has category 6, which is none of the detector's five classes"),
        (said(1, 17), "has category 17, which the dataset does not have"),
        (said(1, CAR, (1, 2, 3)), "has no `bbox` of left, top, width and height"),
        (said(1, CAR, (1, 2, -3, 4)), "has a `bbox` of negative width or height"),
        (said(1, CAR, (1, 2, NAN, 4)), "has a `bbox` that is not of finite numbers"),
        (said(1, CAR, det=1.2), "is not within 0 and 1"),
        (said(1, CAR) | {"score": NAN}, "has no finite number as `score`"),
        (said(1, CRACK, det=0.9, cls=0.5) | {"score": 0.9}, "has the score 0.9, and its parts make 0.45"),
        (said(1, CRACK) | {"attributes": {"det_conf": 0.9}}, "and has no attribute `cls_conf`"),
        (said(1, CAR) | {"score": "high"}, "has no finite number as `score`"),
        ({"image_id": 1, "category_id": 5, "bbox": [1, 2, 3, 4]}, "has neither `score` nor"),
        (said(1, CAR) | {"attributes": [1]}, "has `attributes` that are no mapping"),
        (said(1, CRACK, area_m2=0.0), "has `area_m2` 0, which is not above 0"),
        ({"bbox": [1, 2, 3, 4]}, "has no finite number as `image_id`"),
        (7, "is not a mapping"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, row: Any, message: str) -> None:
    with pytest.raises(PaveTwinError) as refused:
        scene(tmp_path, [[true(CAR)]], [said(1, CAR), row])
    assert str(refused.value).startswith(f"'{tmp_path / 'found.json'}': entry 2 ")
    assert message in str(refused.value)


def test_the_score_alone_is_the_final_confidence(tmp_path: Path) -> None:
    row = said(1, CRACK, det=0.9, cls=0.5)
    del row["attributes"]
    _, (box,) = scene(tmp_path, [[true(CRACK)]], [row])
    assert (box.detection, box.confidence) == (0.45, 0.45)
    assert box.box == (10.0, 10.0, 50.0, 40.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [("{}", "is not a list of detections"), ("[", "cannot be read as JSON"), (None, "cannot be")],
)
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: str | None, message: str) -> None:
    from pavetwin.training.evaluation.detections import read_detections

    split, _ = scene(tmp_path, [[true(CAR)]], [])
    path = tmp_path / "other.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(PaveTwinError, match=message):
        read_detections(path, (split,))

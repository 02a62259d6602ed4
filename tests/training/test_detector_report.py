"""Which errors of a detector are shown first, and what is said of them."""

from pathlib import Path

from pavetwin.training.evaluation.evaluate import DetectorEvaluation, evaluate
from pavetwin.training.report.worst import false_alarms, missed
from scenes.detections import CAR, CRACK, CROCODILE, FAR, PERSON, POTHOLE, said, scene, true

SMALL = (100.0, 20.0, 8.0, 8.0)


def evaluated(folder: Path) -> DetectorEvaluation:
    """A twin of a right box, a wrong subtype, a poor box, one on nothing; what is not confident is not an error."""
    images = [
        [true(CRACK), true(POTHOLE, FAR), true(PERSON, SMALL)],
        [true(CRACK, FAR, contrast=21.0), true(CAR, FAR), true(CAR, SMALL), true(CAR, ignored=True)],
    ]
    rows = [
        said(1, CRACK, det=0.9),
        said(1, CRACK, det=0.8),
        said(1, CROCODILE, FAR, det=0.7),
        said(1, PERSON, (104.0, 20.0, 8.0, 8.0), det=0.6),
        said(2, POTHOLE, (20.0, 150.0, 30.0, 30.0), det=0.95),
        said(2, CAR, (60.0, 150.0, 30.0, 30.0), det=0.2),
        said(2, CAR, det=0.5),
    ]
    return evaluate(*scene(folder, images, rows), resamples=0)


def test_false_alarms_begin_with_the_most_confident(tmp_path: Path) -> None:
    found = [(error.image.number, error.heading, error.about) for error in false_alarms(evaluated(tmp_path))]
    assert found == [
        (2, "Pothole 0.95", "nothing is there"),
        (1, "Single Crack 0.80", "found already, IoU 1.00"),
        (1, "Crocodile Crack 0.70", "is a Pothole, IoU 1.00"),
        (1, "Person 0.60", "box does not fit, IoU 0.33"),
    ]


def test_missed_objects_begin_with_the_largest_of_each_class(tmp_path: Path) -> None:
    found = [(error.image.number, error.heading, error.about) for error in missed(evaluated(tmp_path))]
    assert found == [
        (2, "Single Crack missed", "40 × 30 px, contrast 21"),
        (1, "Pothole missed", "40 × 30 px"),
        (1, "Person missed", "8 × 8 px"),
        (2, "Car missed", "40 × 30 px"),
        (2, "Car missed", "8 × 8 px"),
    ]

"""What `pavetwin capture stats` prints."""

from io import StringIO

import pytest
from rich.console import Console

from pavetwin.capture.record import SIZES, Statistics
from pavetwin.capture.truth import Reason
from pavetwin.cli import capture
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import categories

LEVELS = ("low", "medium", "high")


def large() -> Statistics:
    """A dataset of 100,000 pictures."""
    made = Statistics()
    for number, category in enumerate(categories()):
        for split in SPLITS:
            made.images[split], made.empty[split] = 123_456, 12_345
            made.labelled[category.name, split] = 1_234_567
            if number < 3:
                made.distinct[category.name, split] = {f"d{k}" for k in range(1_234)}
        for level in LEVELS[: 3 * (number < 3)]:
            made.severities[category.name, level] = 1_234_567
        for size, _ in SIZES:
            made.sizes[category.name, size] = 1_234_567
        for reason in Reason:
            made.ignored[category.name, reason.value] = 123_456
    return made


@pytest.mark.parametrize("columns", [80, 120])
def test_nothing_is_shortened(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    said = StringIO()
    monkeypatch.setattr(capture, "out", Console(file=said, width=columns, highlight=False))
    capture._print(large())
    lines = said.getvalue().splitlines()
    assert max(map(len, lines)) <= columns
    assert "…" not in said.getvalue()
    words = said.getvalue().split()
    for word in (*SPLITS, *LEVELS, *(size for size, _ in SIZES), *(reason.value for reason in Reason), "severity"):
        assert word in words
    rows = [line for line in lines if line.startswith("Crocodile Crack")]
    assert [row.split()[2:] for row in rows] == [
        ["1234567"] * 3 + ["3702"],
        ["1234567"] * 6,
        ["123456"] * len(Reason),
    ]
    assert ["images", *["123456"] * 3] in [line.split() for line in lines]
    assert ["without", "defects", *["12345"] * 3] in [line.split() for line in lines]


def test_people_and_cars_have_no_severity(monkeypatch: pytest.MonkeyPatch) -> None:
    said = StringIO()
    monkeypatch.setattr(capture, "out", Console(file=said, width=80, highlight=False))
    capture._print(large())
    rows = [line.split()[1:] for line in said.getvalue().splitlines() if line.startswith("Car ")]
    assert rows[0][-1] == "–"
    assert rows[1] == ["–"] * 3 + ["1234567"] * 3


def test_images_that_are_not_as_requested_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    said = StringIO()
    monkeypatch.setattr(capture, "out", Console(file=said, width=80, highlight=False))
    made = large()
    capture._print(made)
    assert "Note:" not in said.getvalue()
    made.missed_requests = 3
    capture._print(made)
    assert f"Note: 3 of {3 * 123_456} images do not show" in said.getvalue()

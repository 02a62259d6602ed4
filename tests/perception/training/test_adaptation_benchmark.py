"""`python -m benchmarks.adaptation`: equal runs, each variant beside the plain one, and nothing trained twice."""

import json
from pathlib import Path

import pytest
from benchmarks import adaptation
from benchmarks.adaptation import PLAIN, VARIANTS, main, options_of, shortened

from pavetwin.perception.examples.opening import read_examples
from pavetwin.perception.training.options import TrainingMachine, TrainingOptions
from pavetwin.perception.training.schedule import phases_of
from pavetwin.perception.training.trainer import Trainer
from pavetwin.perception.training.watchers import Silent
from scenes.drawn_roads import drawn_roads

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, native=True, epochs=1, classifier_epochs=0, batch=4, mosaic_off=0, seed=3
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Weights, synthetic images, and photographs."""
    path = tmp_path_factory.mktemp("data")
    town = drawn_roads(path / "town", {"train": 16, "val": 3}, synthetic=True)
    photographs = drawn_roads(path / "photographs", {"train": 6, "val": 2, "test": 3}, seed=9)
    Trainer(read_examples([town]), path / "run", TINY, TrainingMachine("cpu"), Silent()).run()
    return path / "run" / "best.pt", town, photographs


def test_every_variant_makes_the_same_number_of_steps_from_the_same_images(folders: tuple[Path, Path, Path]) -> None:
    start, town, _ = folders
    drawn = []
    for variant in VARIANTS.values():
        options = options_of(start, variant, steps=3, batch=4, rate=1e-3, seed=1)
        assert (options.image_px, options.native, options.architecture) == (64, True, TINY.architecture)
        (kept,) = shortened(read_examples([town]), 12, options)
        members = [(kept, each) for each in kept.examples if each.split == "train"]
        assert 12 <= phases_of(members, options)[0].main < 12 + 3
        drawn.append(kept.fingerprint)
    assert len(set(drawn)) == 1
    other = options_of(start, VARIANTS[PLAIN], steps=3, batch=4, rate=1e-3, seed=2)
    assert shortened(read_examples([town]), 12, other)[0].fingerprint != drawn[0]


def test_the_table_has_each_variant_beside_the_plain_one_and_runs_are_kept(
    folders: tuple[Path, Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    start, town, photographs = folders
    words = [str(start), str(town), "--photographs", str(photographs), "-o", str(tmp_path), "--seeds", "2"]
    words += ["--steps", "10", "--batch", "4", "--only", "Fourier amplitudes", "labelled photographs"]
    assert main(words) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[0] for row in rows[2:]] == ["| plain", "| Fourier amplitudes", "| labelled photographs"]
    told = {each.name: json.loads((each / "run.json").read_text())["options"] for each in tmp_path.iterdir()}
    assert len(told) == 6
    assert told["fourier-amplitudes-1"] == {**told["plain-1"], "fourier": 0.01}
    assert told["labelled-photographs-0"]["order"] == "mixed"
    assert "photographs" not in json.loads((tmp_path / "plain-0" / "run.json").read_text())
    monkeypatch.setattr(adaptation.Study, "_train", lambda *_: pytest.fail("trained again"))
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines() == rows


def test_too_few_images_are_one_line(
    folders: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, town, photographs = folders
    assert main([str(start), str(town), "--photographs", str(photographs), "-o", str(tmp_path), "--steps", "99"]) == 2
    assert "`steps`: the datasets have" in capsys.readouterr().err

"""`python -m benchmarks.adaptation`: equal runs, each variant beside the plain one, and nothing trained twice."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks import adaptation
from benchmarks.adaptation import PLAIN, VARIANTS, composites_of, main, options_of, shortened

from pavetwin.errors import PaveTwinError
from pavetwin.perception.shipped import model_path
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.schedule import phases_of
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
from scenes.drawn_roads import NAMES, drawn_roads

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, native=True, epochs=1, classifier_epochs=0, batch=4, mosaic_off=0, seed=3
)

DAMAGE = NAMES[:3]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Weights, synthetic images, and photographs."""
    path = tmp_path_factory.mktemp("data")
    town = drawn_roads(path / "town", {"train": 16, "val": 3}, synthetic=True)
    photographs = drawn_roads(path / "photographs", {"train": 16, "val": 2, "test": 3}, seed=9, names=DAMAGE)
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
        assert 12 <= phases_of(members, replace(options, order="synthetic"))[0].main < 12 + 3
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


def test_a_run_begins_with_the_network_and_the_images_of_a_model_that_ships() -> None:
    options = options_of(model_path("synthetic-1"), VARIANTS[PLAIN], steps=3, batch=4, rate=1e-3, seed=1)
    assert (options.image_px, options.native) == (320, True)
    assert options.architecture == TrainingOptions().architecture


@pytest.fixture(scope="module")
def composites(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the first and the third photograph, and of one that only tests, beside the photographs themselves."""
    made = tmp_path_factory.mktemp("data") / "composites"
    drawn_roads(made, {"train": 7}, seed=9)
    labels = made / "annotations" / "instances_train.json"
    content = json.loads(labels.read_text())
    for image, name in zip(content["images"], ("000", "002", "099", "000", "001", "002", "003"), strict=True):
        own = name + ("-composite" if image["id"] < 3 else "")
        (made / "images" / "train" / image["file_name"]).rename(made / "images" / "train" / f"{own}.jpg")
        image["file_name"] = f"{own}.jpg"
    for each in content["annotations"]:
        each["attributes"] = {"cut_out": "a cut-out"}
    labels.write_text(json.dumps(content))
    return made


def test_composites_stand_beside_the_photographs_that_they_were_made_of(
    folders: tuple[Path, Path, Path], composites: Path
) -> None:
    (photographs,), (made,) = read_examples([folders[2]]), read_examples([composites])
    bare, of_these = composites_of(photographs, made)
    assert [each.name for each in bare.examples if each.split == "train"] == ["000.png", "002.png"]
    assert {each.name for each in of_these.examples} == {"000-composite.jpg", "002-composite.jpg"}
    with pytest.raises(PaveTwinError, match="has no composites of the training photographs"):
        composites_of(photographs, photographs)


def test_composites_are_compared_with_bare_roads_and_other_images_have_a_table(
    folders: tuple[Path, Path, Path], composites: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, town, photographs = folders
    cars = drawn_roads(tmp_path / "cars", {"test": 3}, seed=4, names=("Car",))
    words = [str(start), str(town), "--photographs", str(photographs), "-o", str(tmp_path / "out"), "--seeds", "1"]
    words += ["--steps", "10", "--batch", "4", "--composites", str(composites), "--also", str(cars)]
    assert main([*words, "--only", "composites", "photographs alone", "mostly photographs"]) == 0
    first, other = (part.splitlines() for part in capsys.readouterr().out.strip().split("\n\n"))
    rows = ["plain", "mostly photographs", "photographs alone", "bare roads", "composites, less bare roads"]
    assert [row.split(" | ")[0] for row in first[2:]] == [f"| {name}" for name in rows]
    assert [row.split(" | ")[0] for row in other[2:]] == [f"| {name}" for name in rows]
    assert other[0].startswith("| variant | mAP@0.5 of `--also` |")
    runs = {each.name: each for each in (tmp_path / "out").iterdir()}
    stages = {name: {row.split(",")[0] for row in told(each)} for name, each in runs.items()}
    assert stages["photographs-alone-0"] == {"all"}
    assert stages["mostly-photographs-0"] == {"real"}
    assert stages["composites-0"] == stages["bare-roads-0"] == {"mixed"}


def told(run: Path) -> list[str]:
    """Rows of a run's curves."""
    return (run / "curves.csv").read_text().splitlines()[1:]


def test_composites_are_asked_for_where_they_are_needed(
    folders: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, town, photographs = folders
    words = [str(start), str(town), "--photographs", str(photographs), "-o", str(tmp_path)]
    assert main([*words, "--only", "composites"]) == 2
    assert "--composites: " in capsys.readouterr().err


def test_too_few_images_are_one_line(
    folders: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, town, photographs = folders
    assert main([str(start), str(town), "--photographs", str(photographs), "-o", str(tmp_path), "--steps", "99"]) == 2
    assert "`steps`: the datasets have" in capsys.readouterr().err

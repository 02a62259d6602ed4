"""`python -m benchmarks.full_training`: from a recipe to tables, stopped and continued, and refused in time."""

import json
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

import pytest
import yaml
from benchmarks import full_training
from benchmarks.full_training import Study, jobs, main
from benchmarks.training import ORDERS, PHOTOGRAPHS, PLAIN
from benchmarks.training_recipe import TrainingRecipe

from pavetwin.errors import PaveTwinError
from pavetwin.perception.inference.model_file import open_session
from pavetwin.perception.shipped import DEFAULT
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.datasets.recipe import RecipePack, pack
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

RECIPES = Path(__file__).resolve().parents[3] / "recipes"
NETWORK = {"width": 0.03, "depth": 0.01}
TINY = {**NETWORK, "image_px": 64, "batch": 4, "epochs": 1, "classifier_epochs": 0, "mosaic_off": 0}


@pytest.fixture
def recipe(tmp_path: Path) -> Callable[..., Path]:
    """A file: two datasets, a training on photographs, and one that begins where that ended."""
    drawn_roads(tmp_path / "town", {"train": 8, "val": 2, "test": 3}, size=(64, 48), synthetic=True)
    drawn_roads(tmp_path / "photographs", {"train": 8, "val": 2, "test": 2}, size=(64, 48), seed=9)

    def write(**changes: Any) -> Path:
        content = {
            "datasets": {"town": "town", "photographs": "photographs"},
            "settings": TINY,
            "seeds": 1,
            "trainings": {
                "real": {"datasets": ["photographs"], "licence": "Apache-2.0; mine"},
                "mixed": {"datasets": ["photographs", "town"], "start": "real", "settings": {"order": "mixed"}},
            },
        }
        (tmp_path / "recipe.yaml").write_text(yaml.safe_dump({**content, **changes}, sort_keys=False))
        return tmp_path / "recipe.yaml"

    return write


def test_a_recipe_becomes_models_reports_and_tables(
    recipe: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped at once, it goes on; finished, nothing is made again."""
    its = full_training.variants
    monkeypatch.setattr(its, "RECIPE", {**NETWORK, "native": True, "classifier_epochs": 0, "mosaic_off": 0})
    monkeypatch.setattr(its, "GROUPS", {"orders": {name: ORDERS[name] for name in (PHOTOGRAPHS, PLAIN)}})
    file = recipe(beside=["synthetic-1"], variants={"synthetic": "town", "photographs": "photographs", "views": 8})
    output = tmp_path / "out"
    words = [str(file), "-o", str(output), "--resamples", "20"]
    assert main([*words, "--stop-after", "0"]) == 0
    assert "Stopped in time; the same command goes on" in capsys.readouterr().out
    assert not (output / "models").exists()
    assert main(words) == 0, capsys.readouterr().err
    assert [path.name for path in sorted((output / "models").iterdir())] == ["mixed-n-0.onnx", "real-n-0.onnx"]
    assert open_session(output / "models" / "real-n-0.onnx", 1)[1].licence == "Apache-2.0; mine"
    assert (output / "reports" / "mixed-n" / "town" / "report.html").is_file()
    told = (output / "tables.md").read_text()
    assert told.startswith(
        "## town: 3 test images\n\n| training | mAP@0.5 | of each run | less synthetic-1, 95 % interval |"
    )
    assert [line for line in told.splitlines() if line.startswith("###")] == [
        f"### {name} on {where}, seed 0"
        for where in ("town", "photographs")
        for name in ("synthetic-1", "real n", "mixed n")
    ]
    assert "| mean of the classes with objects |" in told
    compared = (output / "variants.md").read_text()
    assert f"| {PHOTOGRAPHS} |" in compared
    assert f"| {PLAIN} |" in compared

    monkeypatch.setattr(full_training.Study, "_train", lambda *_: pytest.fail("trained again"))
    monkeypatch.setattr(its.Study, "_train", lambda *_: pytest.fail("trained again"))
    assert main(words) == 0
    assert (output / "tables.md").read_text() == told


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"beside": ["synthetic-0"]}, "There is no model 'synthetic-0': name one that ships"),
        ({"training": {}}, "unknown key 'training' (did you mean 'trainings'?)"),
        ({"settings": {"epoch": 3}}, "trainings.real: `overrides`: no setting 'epoch' (did you mean 'epochs'?)"),
        ({"settings": {"seed": 3}}, "settings: seed is given by sizes and seeds"),
        ({"sizes": ["xl"]}, "sizes.1: it must be 'n', 's', 'm' or 'l'"),
        ({"trainings": {"a": {"datasets": ["twn"]}}}, "no dataset 'twn' (did you mean 'town'?)"),
        ({"trainings": {"a": {"datasets": ["town"], "start": "a"}}}, "trainings.a.start: 'a' comes later"),
        ({"trainings": {"a": {"datasets": ["town"], "start": "none.onnx"}}}, "there is no file of weights 'none.onnx'"),
        ({"datasets": {"town": "town.yaml"}, "trainings": {"a": {"datasets": ["town"]}}}, "'town' was not built"),
    ],
)
def test_what_cannot_work_is_refused(
    recipe: Callable[..., Path],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    told: str,
) -> None:
    (tmp_path / "town.yaml").write_text("world: {}\n")
    assert main([str(recipe(**changes)), "-o", str(tmp_path / "out")]) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("Error")]
    assert told in lines[-1]
    assert not (tmp_path / "out" / "runs").exists()


def test_a_dataset_of_smaller_pictures_is_the_packed_one(tmp_path: Path) -> None:
    shown = {"train": 2, "val": 1}
    both = (("plain", {"longest_px": None}, {**shown, "test": 1}), ("small", {"longest_px": 32}, shown))
    for name, packed, splits in both:
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump({"pack": packed}))
        built = tmp_path / "out" / "datasets" / name
        drawn_roads(built / "synthetic", splits, size=(64, 48))
        (built / "built").touch()
        pack([built / "synthetic"], built / "all.pack", RecipePack(longest_px=32))
    content = {
        "datasets": {"plain": "plain.yaml", "small": "small.yaml"},
        "settings": TINY,
        "seeds": 1,
        "trainings": {"real": {"datasets": ["plain", "small"]}},
    }
    (tmp_path / "recipe.yaml").write_text(yaml.safe_dump(content))
    recipe = TrainingRecipe.read(tmp_path / "recipe.yaml")
    study = Study(recipe, tmp_path, tmp_path / "out", machine=TrainingMachine("cpu"), deadline=inf)
    plain, small = read_examples(list(study.datasets.values()))
    assert [max(each.examples[0].size_px) for each in (plain, small)] == [64, 32]
    assert list(study.splits) == ["plain"]
    (tmp_path / "plain.yaml").write_text(yaml.safe_dump({"pack": {"longest_px": 32}}))
    again = Study(recipe, tmp_path, tmp_path / "out", machine=TrainingMachine("cpu"), deadline=inf)
    with pytest.raises(PaveTwinError, match=r"makes pictures smaller \(pack.longest_px\), and has some to test on"):
        _ = again.datasets


def test_a_recipe_that_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"The recipe '.*none.yaml' cannot be read"):
        TrainingRecipe.read(tmp_path / "none.yaml")


@pytest.mark.parametrize("name", ["full-training-cpu", "full-training-gpu"])
def test_the_recipes_of_the_project_are_read_and_compare_whole_seeds(name: str) -> None:
    recipe = TrainingRecipe.read(RECIPES / f"{name}.yaml")
    assert all((RECIPES / path).is_file() for path in recipe.datasets.values())
    runs = len(recipe.sizes) * len(recipe.trainings)
    assert [seed for seed, *_ in jobs(recipe)] == [seed for seed in range(3) for _ in range(runs)]
    if name.endswith("cpu"):
        told = json.loads((RECIPES / "runs" / DEFAULT / "run.json").read_text())
        assert recipe.options("synthetic", "n", 0) == TrainingOptions.parse(told["options"])
        assert recipe.trainings["synthetic"].start == DEFAULT
    else:
        streets = [("streets", f"synthetic-8/seed-{seed}", seed) for seed in range(3)]
        for training, name, seed in (("synthetic", "synthetic-7", 1), ("mixed", "mixed-3", 2), *streets):
            told = json.loads((RECIPES / "runs" / name / "run.json").read_text())
            assert recipe.options(training, "n", seed) == TrainingOptions.parse(told["options"])
            assert Path(recipe.trainings[training].start or "").name == told["start"]

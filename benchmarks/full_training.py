"""`python -m benchmarks.full_training RECIPE.yaml -o FOLDER`: the trainings of a recipe and their tables.

    python -m benchmarks.full_training recipes/full-training-cpu.yaml -o out/training
    python -m benchmarks.full_training recipes/full-training-gpu.yaml -o out/training --stop-after 540

Builds the datasets, runs every training of the recipe in every size with several random seeds, exports the best
weights and looks at the split `test` of each dataset with the exported file. `tables.md` is written after each seed, a
report page for the first run of each training. In the end networks and orders of training are compared
(`benchmarks.training`), in `variants.md`. What is there is not made again, and what was stopped goes on, so that the
same command continues. Needs PyTorch, onnxruntime and pycocotools.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from benchmarks import training as variants
from benchmarks.adaptation import write_found
from benchmarks.model_tables import tables_of
from benchmarks.training_recipe import TrainingRecipe
from pavetwin.cli.console import err, fail, out
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.perception.shipped import model_path, start_path
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.datasets.recipe import FILE as PACKED
from pavetwin.training.datasets.recipe import recipe_values
from pavetwin.training.evaluation.detections import FoundBox, read_detections
from pavetwin.training.evaluation.evaluate import RESAMPLES, evaluate
from pavetwin.training.evaluation.labelled import LabelledSplit, numbered_after, read_split
from pavetwin.training.evaluation.running import LEAST_CONFIDENCE, found_by
from pavetwin.training.report.write import write_detector_report
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

BUILT: Final = ("synthetic", "export")
"""Folders in which `pavetwin data build` leaves COCO files."""

Found = dict[str, list[FoundBox]]
"""What a run finds in each test split."""


class OutOfTimeError(Exception):
    """The time that was given is over; everything is saved."""


class Study:
    """The runs of a recipe, and what they find."""

    def __init__(
        self, recipe: TrainingRecipe, beside: Path, folder: Path, *, machine: TrainingMachine, deadline: float
    ) -> None:
        """Args:
        beside: the folder of the recipe's file.
        deadline: by `time.monotonic`.
        """
        self._recipe, self._beside, self._folder = recipe, beside, folder
        self._machine, self._deadline = machine, deadline

    @cached_property
    def datasets(self) -> dict[str, Path]:
        """Folders with COCO files, by name; they are built where that has not been done. A recipe that packs smaller
        pictures is taken for its packed file.

        Raises:
            PaveTwinError: one cannot be built.
        """
        return {name: self._built(name, self._beside / source) for name, source in self._recipe.datasets.items()}

    def _built(self, name: str, source: Path) -> Path:
        if source.is_dir():
            return source
        target = self._folder / "datasets" / name
        if not (target / "built").is_file():
            words = ["data", "build", str(source), "-o", str(target)]
            err.line(f"pavetwin {' '.join(words)}")
            done = subprocess.run([sys.executable, "-c", "from pavetwin.cli import main; main()", *words], check=False)
            if done.returncode:
                raise PaveTwinError(f"The dataset '{name}' was not built; mend what is told above.")
            (target / "built").touch()
        made = [target / each for each in BUILT if (target / each / "annotations").is_dir()]
        if len(made) != 1:
            raise PaveTwinError(
                f"The recipe '{source}' makes {len(made)} datasets with COCO files; give photographs and synthetic "
                "images a recipe each, and photographs `export: [coco]`."
            )
        if not (recipe_values(source)[0].get("pack") or {}).get("longest_px"):
            return made[0]
        if (made[0] / "annotations" / "instances_test.json").is_file():
            raise PaveTwinError(
                f"The recipe '{source}' makes pictures smaller (pack.longest_px), and has some to test on."
            )
        return target / PACKED

    @cached_property
    def splits(self) -> dict[str, LabelledSplit]:
        """The test images of each dataset that has some, numbered apart."""
        found: dict[str, LabelledSplit] = {}
        for name, path in self.datasets.items():
            if not (path / "annotations" / "instances_test.json").is_file():
                continue
            split = read_split(path, "test")
            for other in found.values():
                split = numbered_after(split, other)
            found[name] = split
        return found

    def found(self, name: str, size: str, seed: int) -> Found:
        """What a run finds; it is trained and exported unless that has been done.

        Raises:
            OutOfTimeError: before the run was finished.
        """
        run, model = self._run(name, size, seed), self.model(name, size, seed)
        if not model.is_file():
            self._train(name, size, seed, run)
            from pavetwin.training.trainer.export import export

            export(run, model, licence=self._recipe.trainings[name].licence, half=True)
        return self.seen_by(model, run)

    def seen_by(self, model: Path, folder: Path) -> Found:
        """What an exported model finds; it has looked at the images where the folder holds that."""
        files = {where: folder / f"found-{where}.json" for where in self.splits}
        if not all(file.is_file() for file in files.values()):
            from pavetwin.perception.inference import Detector

            detector = Detector(model, confidence=LEAST_CONFIDENCE)
            folder.mkdir(parents=True, exist_ok=True)
            for where, split in self.splits.items():
                write_found(files[where], found_by(detector, (split,)), split)
        return {where: list(read_detections(file, (self.splits[where],))) for where, file in files.items()}

    def found_beside(self, name: str) -> Found:
        """What a model finds that the trainings are compared with."""
        return self.seen_by(self.model_beside(name), self._folder / "beside" / Path(name).stem)

    def model_beside(self, name: str) -> Path:
        """The file of such a model: beside the recipe, or one that ships.

        Raises:
            PaveTwinError: there is no such model.
        """
        file = self._beside / name
        return model_path(file if file.is_file() else name)

    def _run(self, name: str, size: str, seed: int) -> Path:
        return self._folder / "runs" / f"{name}-{size}-{seed}"

    def model(self, name: str, size: str, seed: int) -> Path:
        """The exported file of a run."""
        return self._folder / "models" / f"{name}-{size}-{seed}.onnx"

    def _train(self, name: str, size: str, seed: int, run: Path) -> None:
        from pavetwin.training.trainer.trainer import Trainer
        from pavetwin.training.trainer.watchers import PlainLines

        self.check_time()
        sets = read_examples([self.datasets[each] for each in self._recipe.trainings[name].datasets])
        options = self._recipe.options(name, size, seed)
        trainer = Trainer(sets, run, options, self._machine, PlainLines(), self.start(name, size, seed))
        if not trainer.run(max(0.0, self._deadline - time.monotonic())):
            raise OutOfTimeError

    def start(self, name: str, size: str, seed: int) -> Path | None:
        """The weights that a training begins with: of an earlier training of the recipe, or a file, or what ships.

        Raises:
            PaveTwinError: there is no such file.
        """
        begin = self._recipe.trainings[name].start
        if begin is None:
            return None
        if begin in self._recipe.trainings:
            return self._run(begin, size, seed) / "best.pt"
        beside = self._beside / begin
        return start_path(beside if beside.is_file() else begin)

    def report(self, name: str, size: str, found: Found, resamples: int) -> None:
        """A page for each test split, with the worst errors as pictures; made once."""
        for where, split in self.splits.items():
            folder = self._folder / "reports" / f"{name}-{size}" / where
            if not (folder / "report.html").is_file():
                result = evaluate(split, found[where], resamples=resamples)
                write_detector_report(result, folder, title=f"{name}, size {size}, on {where}")

    def compare_variants(self, resamples: int) -> None:
        """Networks and orders of training for the same number of views, in `variants.md`."""
        asked = self._recipe.variants
        if asked is None:
            return
        settings = TrainingOptions.parse(self._recipe.settings)
        recipe: dict[str, Any] = {**variants.RECIPE, "image_px": settings.image_px, "batch": settings.batch}
        folders = [self.datasets[each] for each in (asked.synthetic, asked.photographs)]
        study = variants.Study(folders[:1], folders[1], self._folder / "variants", asked.views, recipe)
        chosen = variants.chosen(list(variants.GROUPS))
        runs: dict[str, list[Mapping[str, list[FoundBox]]]] = {name: [] for name in chosen}
        for seed in range(self._recipe.seeds):
            for name, its in chosen.items():
                self.check_time()
                err.line(f"Variant: {name}, seed {seed}")
                runs[name].append(study.found(name, its, seed))
            told = variants.shown(list(variants.GROUPS), runs, study.splits, resamples)
            _write(self._folder / "variants.md", told + "\n")

    def check_time(self) -> None:
        """Raises:
        OutOfTimeError: the time is over.
        """
        if time.monotonic() > self._deadline:
            raise OutOfTimeError


def jobs(recipe: TrainingRecipe) -> Iterator[tuple[int, str, str]]:
    """Seed, size and training, seed by seed, so that a study that is stopped has whole comparisons."""
    names = recipe.trainings
    return ((seed, size, name) for seed in range(recipe.seeds) for size in recipe.sizes for name in names)


def run(study: Study, recipe: TrainingRecipe, folder: Path, resamples: int) -> None:
    """Everything that is not there yet.

    Args:
        resamples: of the bootstrap over images.

    Raises:
        OutOfTimeError: before its end; the same call goes on.
    """
    todo = list(jobs(recipe))
    for seed, size, name in todo:
        study.start(name, size, seed)  # what is missing is told before hours of work
    for name in recipe.beside:
        study.model_beside(name)
    found = {name: [study.found_beside(name)] for name in recipe.beside}
    for at, (seed, size, name) in enumerate(todo, start=1):
        err.line(f"{at} of {len(todo)}: {name}, size {size}, seed {seed}")
        told = study.found(name, size, seed)
        found.setdefault(f"{name} {size}", []).append(told)
        if seed == 0:
            study.report(name, size, told, resamples)
        if at % (len(todo) // recipe.seeds) == 0:
            _write(folder / "tables.md", tables_of(found, study.splits, resamples))
    study.compare_variants(resamples)


def _write(path: Path, text: str) -> None:
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.full_training", description=__doc__.splitlines()[0])
    parser.add_argument("recipe", type=Path, metavar="RECIPE.yaml")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of datasets, runs and tables")
    parser.add_argument("--stop-after", type=float, metavar="MINUTES", help="save after this time, and stop")
    parser.add_argument("--workers", type=int, default=0, help="processes that prepare images")
    parser.add_argument("--held-gb", type=float, default=2.0, help="decoded pictures of each dataset kept in memory")
    parser.add_argument("--views", default="", help="where views are drawn, as `pavetwin train` has it")
    parser.add_argument("--resamples", type=int, default=RESAMPLES, help="of the bootstrap over images")
    asked = parser.parse_args(arguments)
    deadline = float("inf") if asked.stop_after is None else time.monotonic() + 60 * asked.stop_after
    try:
        recipe = TrainingRecipe.read(asked.recipe)
        beside = asked.recipe.absolute().parent
        machine = TrainingMachine(workers=asked.workers, held_gb=asked.held_gb, views=asked.views)
        study = Study(recipe, beside, asked.output, machine=machine, deadline=deadline)
        run(study, recipe, asked.output, asked.resamples)
    except OutOfTimeError:
        out.line(f"Stopped in time; the same command goes on with {asked.output}/.")
        return 0
    except PaveTwinError as error:
        fail(str(error))
        return 2
    out.line(f"Done: {asked.output}/tables.md; models in {asked.output}/models/.")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

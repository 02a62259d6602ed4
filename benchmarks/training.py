"""`python -m benchmarks.training SYNTHETIC… --photographs DATASET -o FOLDER`: networks and orders of training, equal.

    python -m benchmarks.training datasets/synthetic --photographs datasets/real -o out/training
    python -m benchmarks.training datasets/synthetic --photographs datasets/real -o out/training --seeds 1 --only P2

Every variant is trained from random weights on about the same number of views, with several random seeds, and measured
on the split `test` of the synthetic images and of the photographs. Differences are to the first variant of its group,
paired by image; their intervals hold the spread between seeds. A run that is there is not made again, and one that was
stopped goes on, so that the same command continues a study. Needs PyTorch and pycocotools.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.adaptation import VALIDATION, table, with_examples, write_found
from pavetwin.cli.console import fail, progress
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.evaluation.detections import FoundBox, read_detections
from pavetwin.training.evaluation.evaluate import RESAMPLES
from pavetwin.training.evaluation.labelled import LabelledSplit, numbered_after, read_split
from pavetwin.training.evaluation.running import LEAST_CONFIDENCE, found_by
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

RECIPE: Final[Mapping[str, Any]] = {
    "image_px": 320,
    "native": True,
    "batch": 8,
    "rate": 1e-3,
    "ema_steps": 600,
    "mosaic": 0.3,
    "mosaic_off": 1,
    "upside_down": 0.5,
    "warmup_epochs": 0.5,
    "classifier_epochs": 0,
}
"""Of all runs: that of `synthetic-1`, for fewer steps."""

PLAIN, PHOTOGRAPHS = "n, synthetic only", "photographs only"
NETWORKS: Final[Mapping[str, Mapping[str, Any]]] = {
    PLAIN: {"order": "synthetic"},
    "width 0.125": {"order": "synthetic", "width": 0.125},
    "P2": {"order": "synthetic", "p2": True},
    "ReLU": {"order": "synthetic", "activation": "relu"},
    "no mask loss": {"order": "synthetic", "masks": False},
}
"""What the network is, or learns, beside the published one."""

ORDERS: Final[Mapping[str, Mapping[str, Any]]] = {
    PHOTOGRAPHS: {"order": "real", "without": "Person,Car", "masks": False},
    PLAIN: {"order": "synthetic"},
    "mixed, a quarter photographs": {"order": "mixed"},
    "photographs, then synthetic": {"order": "real-synthetic"},
    "synthetic, then photographs": {"order": "synthetic-real"},
}
"""What it is shown, and in which order. In a second stage a quarter of the images is of the first kind."""

GROUPS: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {"networks": NETWORKS, "orders": ORDERS}
METRICS: Final[Mapping[str, Mapping[str, str]]] = {
    "synthetic": {"map50": "five classes, mAP@0.5", "coarse_map50": "three classes, mAP@0.5"},
    "photographs": {"coarse_map50": "Road Defect AP@0.5", "map50": "mAP@0.5 of the subtypes"},
}


class Study:
    """The runs of all variants, and what they find."""

    def __init__(
        self, synthetic: Sequence[Path], photographs: Path, folder: Path, views: int, recipe: Mapping[str, Any]
    ) -> None:
        """Raises:
        PaveTwinError: a dataset cannot be read.
        """
        self._sets = {"synthetic": read_examples(list(synthetic)), "real": read_examples([photographs])}
        self._folder, self._views, self._recipe = folder, views, recipe
        tested = read_split(synthetic[0], "test")
        self.splits = {"synthetic": tested, "photographs": numbered_after(read_split(photographs, "test"), tested)}

    def found(self, name: str, settings: Mapping[str, Any], seed: int) -> dict[str, list[FoundBox]]:
        """What a run finds on each test split; it is trained unless it is there."""
        run = self._folder / f"{name.replace(',', '').replace(' ', '-').lower()}-{seed}"
        files = {where: run / f"found-{where}.json" for where in self.splits}
        if not all(file.is_file() for file in files.values()):
            options = TrainingOptions.parse({**self._recipe, **settings, "seed": seed})
            self._train(run, options)
            from pavetwin.training.trainer.weights_detector import WeightsDetector

            detector = WeightsDetector(run / "best.pt", confidence=LEAST_CONFIDENCE)
            for where, split in self.splits.items():
                write_found(files[where], found_by(detector, (split,)), split)
        return {where: list(read_detections(file, (self.splits[where],))) for where, file in files.items()}

    def _train(self, run: Path, options: TrainingOptions) -> None:
        from pavetwin.training.trainer.trainer import Trainer
        from pavetwin.training.trainer.watchers import Silent

        wanted = options.order.replace("mixed", "synthetic-real").split("-")
        sets, options = sized([each for kind in wanted for each in self._sets[kind]], self._views, options)
        Trainer(sets, run, options, TrainingMachine(), Silent()).run()


def sized(sets: Sequence[ExampleSet], views: int, options: TrainingOptions) -> tuple[list[ExampleSet], TrainingOptions]:
    """As many epochs, and of each set such a share of its training images, that the run has so many views in all; with
    a few images for validation.

    Raises:
        PaveTwinError: there are none to train on.
    """
    from pavetwin.training.trainer.schedule import phases_of

    members = [(data, each) for data in sets for each in data.examples if each.split == "train"]
    epoch = sum(phase.main + phase.drawn for phase in phases_of(members, replace(options, epochs=1)))
    epochs = ceil(views / epoch)
    rng = np.random.default_rng(options.seed)
    kept = []
    for data in sets:
        training = [each for each in data.examples if each.split == "train"]
        count = max(1, round(len(training) * views / (epochs * epoch)))
        drawn = [training[at] for at in sorted(rng.permutation(len(training))[:count])]
        seen = [each for each in data.examples if each.split == "val" and each.objects]
        kept.append(with_examples(data, [*drawn, *seen[:: max(1, len(seen) // VALIDATION)]]))
    return kept, replace(options, epochs=epochs)


def chosen(groups: Sequence[str], only: Sequence[str] | None = None) -> dict[str, Mapping[str, Any]]:
    """Variants of groups with their settings: all, or the first of each group and those that are named."""
    return {
        name: settings
        for group in groups
        for at, (name, settings) in enumerate(GROUPS[group].items())
        if at == 0 or only is None or name in only
    }


def shown(
    groups: Sequence[str],
    runs: Mapping[str, Sequence[Mapping[str, list[FoundBox]]]],
    splits: Mapping[str, LabelledSplit],
    resamples: int = RESAMPLES,
) -> str:
    """A table for each group and test split."""
    parts = []
    for group in groups:
        names = [name for name in GROUPS[group] if runs.get(name)]
        for where, split in splits.items():
            found = {name: [each[where] for each in runs[name]] for name in names}
            parts.append(
                f"{group}, on {where}:\n\n{table(found, split, resamples, base=names[0], metrics=METRICS[where])}"
            )
    return "\n\n".join(parts)


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.training", description=__doc__.splitlines()[0])
    parser.add_argument("datasets", type=Path, nargs="+", metavar="SYNTHETIC", help="the first has the split `test`")
    parser.add_argument("--photographs", type=Path, required=True, metavar="DATASET", help="photographs, split")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--views", type=int, default=15_000, help="of each run")
    parser.add_argument("--image", type=int, default=RECIPE["image_px"], help="side of what the network sees")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each variant")
    parser.add_argument("--groups", nargs="+", choices=list(GROUPS), default=list(GROUPS), metavar="GROUP")
    parser.add_argument("--only", nargs="+", metavar="VARIANT", help="and the first variant of each group")
    asked = parser.parse_args(arguments)
    wanted = chosen(asked.groups, asked.only)
    runs: dict[str, list[dict[str, list[FoundBox]]]] = {name: [] for name in wanted}
    try:
        recipe = {**RECIPE, "image_px": asked.image}
        study = Study(asked.datasets, asked.photographs, asked.output, asked.views, recipe)
        with progress("Training") as tell:
            # Seed by seed, so that a study that is stopped has whole comparisons.
            for at, (seed, name) in enumerate((seed, name) for seed in range(asked.seeds) for name in wanted):
                tell(at / (asked.seeds * len(wanted)), f"Training {name}, seed {seed}")
                runs[name].append(study.found(name, wanted[name], seed))
    except PaveTwinError as error:
        fail(str(error))
        return 2
    print(shown(asked.groups, runs, study.splits))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""`python -m benchmarks.adaptation START DATASET… --photographs DATASET -o FOLDER`: the effect of adaptation.

    python -m benchmarks.adaptation runs/synthetic/best.pt datasets/synthetic --photographs datasets/real \
        -o out/adaptation

Every variant goes on from the same weights for the same number of steps, with several random seeds. Runs of one seed
see the same synthetic images. All are measured on the photographs' split `test`; switches read their split `train`,
and only `labelled photographs` reads its labels. Differences are to `plain`, paired by image, and their intervals hold
the spread between seeds. A run that is there is not made again. Needs PyTorch and pycocotools.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.cli.console import fail, progress
from pavetwin.errors import PaveTwinError
from pavetwin.perception.evaluation.detections import FoundBox, read_detections
from pavetwin.perception.evaluation.evaluate import RESAMPLES, PairedComparison, compare_in_pairs
from pavetwin.perception.evaluation.labelled import LabelledSplit, read_split
from pavetwin.perception.evaluation.running import LEAST_CONFIDENCE, found_by
from pavetwin.perception.examples.example import Example, ExampleSet
from pavetwin.perception.examples.opening import read_examples
from pavetwin.perception.examples.unlabelled import read_unlabelled
from pavetwin.perception.training.options import TrainingMachine, TrainingOptions

PLAIN: Final = "plain"
VALIDATION: Final = 24
"""Images of the validation split that are looked at: the weights of the last step are kept, whatever they show."""

METRICS: Final = {"coarse_map50": "Road Defect AP@0.5", "map50": "mAP@0.5 of the subtypes"}


@dataclass(frozen=True, slots=True)
class Variant:
    """What is changed of the plain run."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    reads_labels: bool = False
    """Whether the photographs are trained on with their labels."""


VARIANTS: Final[Mapping[str, Variant]] = {
    PLAIN: Variant(),
    "Fourier amplitudes": Variant({"fourier": 0.01}),
    "appearance": Variant({"appearance": 0.5}),
    "mean teacher": Variant({"teacher_weight": 1.0, "teacher_after": 0}),
    "labelled photographs": Variant({"order": "mixed"}, reads_labels=True),
}


def options_of(start: Path, variant: Variant, *, steps: int, batch: int, rate: float, seed: int) -> TrainingOptions:
    """The settings of a run: the network and the images are those of the weights that it begins with.

    Raises:
        PaveTwinError: these are no weights.
    """
    from pavetwin.perception.training.run_folder import load_network

    told = load_network(start)[1].get("options", {})
    names = ("size", "width", "depth", "p2", "activation", "masks", "mask_points", "image_px", "native", "upside_down")
    kept = {name: told[name] for name in names if name in told}
    of_run = {"epochs": 1, "classifier_epochs": 0, "mosaic": 0.0, "mosaic_off": 0, "warmup_epochs": 0.1}
    # The average is the teacher: over a good part of so short a run.
    return TrainingOptions.parse(
        {**kept, **of_run, "batch": batch, "rate": rate, "seed": seed, "ema_steps": max(1, steps // 3)}
        | dict(variant.settings)
    )


def shortened(sets: Sequence[ExampleSet], views: int, options: TrainingOptions) -> list[ExampleSet]:
    """The same sets with as many training images, drawn by the seed, as give an epoch of so many views, and with a few
    images for validation."""
    from pavetwin.perception.training.schedule import phases_of

    rng = np.random.default_rng(options.seed)
    members = [(data, each) for data in sets for each in data.examples if each.split == "train"]
    order = [members[at] for at in rng.permutation(len(members))]
    # One image may be several crops of an epoch.
    lengths = [phases_of([each], replace(options, order="synthetic"))[0].main for each in order]
    ends = np.cumsum(lengths)
    if ends[-1] < views:
        raise PaveTwinError(f"`steps`: the datasets have {ends[-1]} views, and the runs need {views}.")
    seen = [(data, each) for data in sets for each in data.examples if each.split == "val" and each.objects]
    drawn = [*order[: int(np.searchsorted(ends, views)) + 1], *seen[:: max(1, len(seen) // VALIDATION)]]
    chosen = {(id(data), each.split, each.name) for data, each in drawn}
    kept = [[each for each in data.examples if (id(data), each.split, each.name) in chosen] for data in sets]
    return [with_examples(data, examples) for data, examples in zip(sets, kept, strict=True) if examples]


def with_examples(data: ExampleSet, examples: Sequence[Example]) -> ExampleSet:
    """The set with only these of its images."""
    names = "\n".join([data.fingerprint, *(each.name for each in examples)])
    return replace(data, examples=tuple(examples), fingerprint=sha256(names.encode()).hexdigest())


class Study:
    """The runs of all variants, and what they find."""

    def __init__(self, start: Path, datasets: Sequence[Path], photographs: Path, folder: Path) -> None:
        """Raises:
        PaveTwinError: a dataset cannot be read.
        """
        self._start, self._folder, self._photographs = start, folder, photographs
        self._synthetic = read_examples(list(datasets))
        (labelled,) = read_examples([photographs])
        self._labelled = with_examples(labelled, [each for each in labelled.examples if each.split == "train"])
        self.split = read_split(photographs, "test")

    def found(self, name: str, variant: Variant, *, steps: int, batch: int, rate: float, seed: int) -> list[FoundBox]:
        """What a run finds on the photographs; it is trained unless it is there."""
        options = options_of(self._start, variant, steps=steps, batch=batch, rate=rate, seed=seed)
        run = self._folder / f"{name.replace(' ', '-').lower()}-{seed}"
        file = run / "found.json"
        if not file.is_file():
            self._train(run, variant, options, steps * batch)
            from pavetwin.perception.training.weights_detector import WeightsDetector

            detector = WeightsDetector(run / "best.pt", confidence=LEAST_CONFIDENCE)
            write_found(file, found_by(detector, (self.split,)), self.split)
        return list(read_detections(file, (self.split,)))

    def _train(self, run: Path, variant: Variant, options: TrainingOptions, views: int) -> None:
        from pavetwin.perception.training.trainer import Trainer
        from pavetwin.perception.training.watchers import Silent

        # Photographs with labels take the place of as many synthetic images.
        own = round(views * (1 - options.replay)) if variant.reads_labels else views
        sets = shortened(self._synthetic, own, options)
        unlabelled = read_unlabelled(self._photographs) if options.adaptations else None
        if variant.reads_labels:
            sets.append(self._labelled)
        Trainer(sets, run, options, TrainingMachine(), Silent(), self._start, unlabelled).run()


def write_found(file: Path, found: Sequence[FoundBox], split: LabelledSplit) -> None:
    """As `pavetwin evaluate` reads it."""
    from pavetwin.perception.classes import NO_SUBTYPE, ROAD_DEFECT, class_of

    numbers = {
        class_of(coarse, subtype): number
        for number, (coarse, subtype) in split.categories.items()
        if (coarse, subtype) != (ROAD_DEFECT, NO_SUBTYPE)
    }
    rows = [
        {
            "image_id": each.image,
            "category_id": numbers[each.number_of_class],
            "bbox": [each.box[0], each.box[1], each.box[2] - each.box[0], each.box[3] - each.box[1]],
            "attributes": {
                "det_conf": each.detection,
                "cls_conf": min(1.0, each.confidence / each.detection),
                **each.sizes,
                **({"severity": each.severity} if each.severity else {}),
            },
        }
        for each in found
        if each.number_of_class in numbers
    ]
    file.write_text(json.dumps(rows), encoding="utf-8")


def table(
    runs: Mapping[str, Sequence[Sequence[FoundBox]]],
    split: LabelledSplit,
    resamples: int = RESAMPLES,
    *,
    base: str = PLAIN,
    metrics: Mapping[str, str] = METRICS,
) -> str:
    """A row for each variant: the mean of its runs, each run, and the difference to the base with its interval."""
    heads = " | ".join(f"{words} | of each run | less {base}, 95 % interval" for words in metrics.values())
    rows = [f"| variant | {heads} |", "|---" * (1 + 3 * len(metrics)) + "|"]
    for name, found in runs.items():
        compared = compare_in_pairs(split, runs[base], found, resamples=resamples)
        rows.append(f"| {name} | {' | '.join(cells_of(compared, key, is_base=name == base) for key in metrics)} |")
    return "\n".join(rows)


def cells_of(compared: PairedComparison, key: str, *, is_base: bool) -> str:
    """The mean of the runs, each run, and the difference to the base with its interval; that is empty for the base."""
    values = [100 * each[key] for each in compared.second]
    told = compared.differences[key]
    less = "" if is_base else f"{100 * told.value:+.1f} ({100 * told.low:+.1f} to {100 * told.high:+.1f})"
    return f"{np.mean(values):.1f} | {', '.join(f'{each:.1f}' for each in values)} | {less}"


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.adaptation", description=__doc__.splitlines()[0])
    parser.add_argument("start", type=Path, metavar="START", help="weights, such as runs/synthetic/best.pt")
    parser.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="synthetic images")
    parser.add_argument("--photographs", type=Path, required=True, metavar="DATASET", help="photographs, split")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--steps", type=int, default=120, help="of each run")
    parser.add_argument("--batch", type=int, default=16, help="images of a step")
    parser.add_argument("--rate", type=float, default=5e-4, help="greatest learning rate")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each variant")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), default=list(VARIANTS), metavar="VARIANT")
    asked = parser.parse_args(arguments)
    names = [PLAIN, *(name for name in asked.only if name != PLAIN)]
    how = {"steps": asked.steps, "batch": asked.batch, "rate": asked.rate}
    runs: dict[str, list[Sequence[FoundBox]]] = {name: [] for name in names}
    try:
        study = Study(asked.start, asked.datasets, asked.photographs, asked.output)
        with progress("Training") as tell:
            # Seed by seed, so that a study that is stopped has whole comparisons.
            for at, (seed, name) in enumerate((seed, name) for seed in range(asked.seeds) for name in names):
                tell(at / (asked.seeds * len(names)), f"Training {name}, seed {seed}")
                runs[name].append(study.found(name, VARIANTS[name], seed=seed, **how))
    except PaveTwinError as error:
        fail(str(error))
        return 2
    print(table(runs, study.split))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""`python -m benchmarks.adaptation START DATASET… --photographs DATASET -o FOLDER`: the effect of adaptation.

    python -m benchmarks.adaptation synthetic-1 datasets/synthetic --photographs datasets/real \
        --composites datasets/composites --also datasets/aerial-cars -o out/adaptation

Every variant goes on from the same weights for the same number of steps, with several random seeds. Runs of one seed
see the same synthetic images. All are measured on the photographs' split `test`, and on that of `--also`; switches read
the split `train` of the photographs without its labels, and the other variants with them. `composites` shows
photographs with people and vehicles put on them, and `bare roads` the same photographs without; both need
`--composites`. Differences are to `plain`, for composites to `bare roads`, paired by image, and their intervals hold
the spread between seeds. A run that is there is not made again. Needs PyTorch and pycocotools.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pavetwin.cli.console import fail, progress
from pavetwin.errors import PaveTwinError
from pavetwin.perception.inference.model_file import open_session
from pavetwin.perception.shipped import start_path
from pavetwin.training.datasets.compositing import COMPOSITE
from pavetwin.training.datasets.examples import Example, ExampleSet
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.datasets.unlabelled import read_unlabelled
from pavetwin.training.evaluation.detections import FoundBox, read_detections
from pavetwin.training.evaluation.evaluate import RESAMPLES, PairedComparison, compare_in_pairs
from pavetwin.training.evaluation.labelled import LabelledSplit, read_split
from pavetwin.training.evaluation.running import LEAST_CONFIDENCE, found_by
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

PLAIN: Final = "plain"
VALIDATION: Final = 24
"""Images of the validation split that are looked at: the weights of the last step are kept, whatever they show."""

METRICS: Final = {"coarse_map50": "Road Defect AP@0.5", "map50": "mAP@0.5 of the subtypes"}
ALSO: Final = {"map50": "mAP@0.5 of `--also`"}

Member = tuple[ExampleSet, Example]


class Shown(Enum):
    """Labelled images that are no captures."""

    NONE = "none"
    PHOTOGRAPHS = "photographs"
    BARE = "those photographs of which there are composites"
    COMPOSITES = "composites"


@dataclass(frozen=True, slots=True)
class Variant:
    """What is changed of the plain run."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    shown: Shown = Shown.NONE
    base: str = PLAIN
    """The variant that it is compared with."""


BARE_ROADS: Final = "bare roads"

VARIANTS: Final[Mapping[str, Variant]] = {
    PLAIN: Variant(),
    "Fourier amplitudes": Variant({"fourier": 0.01}),
    "appearance": Variant({"appearance": 0.5}),
    "mean teacher": Variant({"teacher_weight": 1.0, "teacher_after": 0}),
    "labelled photographs": Variant({"order": "mixed"}, Shown.PHOTOGRAPHS),
    "mostly photographs": Variant({"order": "synthetic-real", "skip_first": True}, Shown.PHOTOGRAPHS),
    "photographs alone": Variant({"order": "real", "without": "Person,Car"}, Shown.PHOTOGRAPHS),
    BARE_ROADS: Variant({"order": "mixed"}, Shown.BARE),
    "composites": Variant({"order": "mixed"}, Shown.COMPOSITES, BARE_ROADS),
}
"""`labelled photographs` are a quarter of the views; `mostly photographs` has a quarter of synthetic ones."""

WITH_COMPOSITES: Final = tuple(name for name, each in VARIANTS.items() if each.shown in (Shown.BARE, Shown.COMPOSITES))


def options_of(start: Path, variant: Variant, *, steps: int, batch: int, rate: float, seed: int) -> TrainingOptions:
    """The settings of a run: the network and the images are those of the weights that it begins with.

    Raises:
        PaveTwinError: these are no weights.
    """
    from pavetwin.training.trainer.exported import is_exported
    from pavetwin.training.trainer.run_folder import load_network

    if is_exported(start):
        facts = open_session(start, 1)[1]
        told = {**facts.architecture, "image_px": facts.image_px, "native": facts.native}
    else:
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
    images for validation.

    Raises:
        PaveTwinError: they have fewer views.
    """
    from pavetwin.training.trainer.schedule import phases_of

    rng = np.random.default_rng(options.seed)
    members = [(data, each) for data in sets for each in data.examples if each.split == "train"]
    order = [members[at] for at in rng.permutation(len(members))]
    # One image may be several crops of an epoch.
    lengths = [phases_of([each], replace(options, order="real-synthetic"))[0].main for each in order]
    ends = np.cumsum(lengths)
    if ends[-1] < views:
        raise PaveTwinError(f"`steps`: the datasets have {ends[-1]} views, and the runs need {views}.")
    return only(sets, [*order[: int(np.searchsorted(ends, views)) + 1], *validating(sets)])


def validating(sets: Sequence[ExampleSet]) -> list[Member]:
    """A few images for validation."""
    seen = [(data, each) for data in sets for each in data.examples if each.split == "val" and each.objects]
    return seen[:: max(1, len(seen) // VALIDATION)]


def only(sets: Sequence[ExampleSet], members: Sequence[Member]) -> list[ExampleSet]:
    """Those of the sets that have any of these images, with only these."""
    chosen = {(id(data), each.split, each.name) for data, each in members}
    kept = [[each for each in data.examples if (id(data), each.split, each.name) in chosen] for data in sets]
    return [with_examples(data, examples) for data, examples in zip(sets, kept, strict=True) if examples]


def composites_of(photographs: ExampleSet, composites: ExampleSet) -> tuple[ExampleSet, ExampleSet]:
    """The photographs of which there are composites, and these composites.

    Raises:
        PaveTwinError: there are none.
    """
    made = {Path(each.name).stem: each for each in composites.examples if Path(each.name).stem.endswith(COMPOSITE)}
    bare = [each for each in photographs.examples if Path(each.name).stem + COMPOSITE in made]
    if not bare:
        raise PaveTwinError(f"'{composites.path}' has no composites of the training photographs.")
    of_these = [made[Path(each.name).stem + COMPOSITE] for each in bare]
    return with_examples(photographs, bare), with_examples(composites, of_these)


def with_examples(data: ExampleSet, examples: Sequence[Example]) -> ExampleSet:
    """The set with only these of its images."""
    names = "\n".join([data.fingerprint, *(each.name for each in examples)])
    return replace(data, examples=tuple(examples), fingerprint=sha256(names.encode()).hexdigest())


class Study:
    """The runs of all variants, and what they find."""

    def __init__(
        self,
        start: Path,
        datasets: Sequence[Path],
        photographs: Path,
        folder: Path,
        *,
        composites: Path | None = None,
        also: Path | None = None,
    ) -> None:
        """Raises:
        PaveTwinError: a dataset cannot be read.
        """
        self._start, self._folder, self._photographs = start, folder, photographs
        self._synthetic = read_examples(list(datasets))
        (labelled,) = read_examples([photographs])
        labelled = with_examples(labelled, [each for each in labelled.examples if each.split == "train"])
        self._shown = {Shown.PHOTOGRAPHS: labelled}
        if composites is not None:
            (made,) = read_examples([composites])
            self._shown[Shown.BARE], self._shown[Shown.COMPOSITES] = composites_of(labelled, made)
        self.splits = {"found.json": read_split(photographs, "test")}
        if also is not None:
            self.splits["found-also.json"] = read_split(also, "test")

    def found(
        self, name: str, variant: Variant, *, steps: int, batch: int, rate: float, seed: int
    ) -> dict[str, list[FoundBox]]:
        """File of detections → what a run finds in its images; it is trained unless it is there."""
        options = options_of(self._start, variant, steps=steps, batch=batch, rate=rate, seed=seed)
        run = self._folder / f"{name.replace(' ', '-').lower()}-{seed}"
        missing = {file: split for file, split in self.splits.items() if not (run / file).is_file()}
        if missing:
            self._train(run, variant, options, steps * batch)
            from pavetwin.training.trainer.weights_detector import WeightsDetector

            detector = WeightsDetector(run / "best.pt", confidence=LEAST_CONFIDENCE)
            for file, split in missing.items():
                write_found(run / file, found_by(detector, (split,)), split)
        return {file: list(read_detections(run / file, (split,))) for file, split in self.splits.items()}

    def _train(self, run: Path, variant: Variant, options: TrainingOptions, views: int) -> None:
        from pavetwin.training.trainer.trainer import Trainer
        from pavetwin.training.trainer.watchers import Silent

        unlabelled = read_unlabelled(self._photographs) if options.adaptations else None
        sets = self._sets(variant, options, views)
        Trainer(sets, run, options, TrainingMachine(), Silent(), self._start, unlabelled).run()

    def _sets(self, variant: Variant, options: TrainingOptions, views: int) -> list[ExampleSet]:
        """What a run is trained on: so many views in all."""
        if variant.shown is Shown.NONE:
            return shortened(self._synthetic, views, options)
        labelled = self._shown[variant.shown]
        # Those that are drawn take the place of as many others.
        own = round(views * (1 - options.replay))
        if options.order == "mixed":
            return [*shortened(self._synthetic, own, options), labelled]
        checked = validating(self._synthetic)
        if options.order == "real":
            return [*shortened([labelled], views, options), *only(self._synthetic, checked)]
        shown = [(data, each) for data in self._synthetic for each in data.examples if each.split == "train"]
        return [*shortened([labelled], own, options), *only(self._synthetic, [*shown, *checked])]


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
    bases: Mapping[str, str] = MappingProxyType({}),
    metrics: Mapping[str, str] = METRICS,
) -> str:
    """A row for each variant: the mean of its runs, each run, and the difference to the base with its interval.

    Args:
        bases: variant → the one that it is compared with, where that is another one.
    """
    heads = " | ".join(f"{words} | of each run | less {base}, 95 % interval" for words in metrics.values())
    rows = [f"| variant | {heads} |", "|---" * (1 + 3 * len(metrics)) + "|"]
    for name, found in runs.items():
        own = bases.get(name, base)
        compared = compare_in_pairs(split, runs[own], found, resamples=resamples)
        told = name if own == base else f"{name}, less {own}"
        rows.append(f"| {told} | {' | '.join(cells_of(compared, key, is_base=name == own) for key in metrics)} |")
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
    parser.add_argument("start", type=Path, metavar="START", help="weights, or a model by file or name")
    parser.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="synthetic images")
    parser.add_argument("--photographs", type=Path, required=True, metavar="DATASET", help="photographs, split")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--composites", type=Path, metavar="DATASET", help="of the same photographs")
    parser.add_argument("--also", type=Path, metavar="DATASET", help="other images to measure on")
    parser.add_argument("--steps", type=int, default=120, help="of each run")
    parser.add_argument("--batch", type=int, default=16, help="images of a step")
    parser.add_argument("--rate", type=float, default=5e-4, help="greatest learning rate")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each variant")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), default=list(VARIANTS), metavar="VARIANT")
    asked = parser.parse_args(arguments)
    names = [name for name in VARIANTS if name in (PLAIN, *asked.only, *(VARIANTS[each].base for each in asked.only))]
    if asked.composites is None:
        if set(asked.only) & set(WITH_COMPOSITES) and set(asked.only) != set(VARIANTS):
            fail(f"--composites: `{BARE_ROADS}` and `composites` need a dataset with composites of the photographs.")
            return 2
        names = [name for name in names if name not in WITH_COMPOSITES]
    how = {"steps": asked.steps, "batch": asked.batch, "rate": asked.rate}
    try:
        study = Study(
            start_path(asked.start),
            asked.datasets,
            asked.photographs,
            asked.output,
            composites=asked.composites,
            also=asked.also,
        )
        runs: dict[str, dict[str, list[Sequence[FoundBox]]]] = {
            file: {name: [] for name in names} for file in study.splits
        }
        with progress("Training") as tell:
            # Seed by seed, so that a study that is stopped has whole comparisons.
            for at, (seed, name) in enumerate((seed, name) for seed in range(asked.seeds) for name in names):
                tell(at / (asked.seeds * len(names)), f"Training {name}, seed {seed}")
                for file, found in study.found(name, VARIANTS[name], seed=seed, **how).items():
                    runs[file][name].append(found)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    bases = {name: VARIANTS[name].base for name in names}
    tables = [
        table(runs[file], split, bases=bases, metrics=metrics)
        for (file, split), metrics in zip(study.splits.items(), (METRICS, ALSO), strict=False)
    ]
    print("\n\n".join(tables))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The training loop: phases of epochs of steps, from where the last checkpoint stands."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import repeat
from math import isfinite
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from pavetwin.errors import PaveTwinError
from pavetwin.perception.classes import CLASSES
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.examples import SPLITS_USED, ExampleSet, labelled_classes
from pavetwin.training.trainer.batches import Batch, TrainingViews, ValidationViews, batches
from pavetwin.training.trainer.checks import check_labels, check_photographs
from pavetwin.training.trainer.device_pictures import DevicePictures, images_of
from pavetwin.training.trainer.distractors import with_distractors
from pavetwin.training.trainer.exported import is_exported, measure_normalisations
from pavetwin.training.trainer.held_pictures import HeldExampleSet
from pavetwin.training.trainer.losses import Losses, detection_losses, mask_loss, subtype_loss
from pavetwin.training.trainer.machine import check_compiler, device_of, draws_views, has_half, held_sets
from pavetwin.training.trainer.network import DetectorNetwork, Encoded
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.references import photometrics
from pavetwin.training.trainer.run_folder import BEST, TAUGHT, Curves, RunFolder, load_weights
from pavetwin.training.trainer.schedule import MovingAverage, Phase, epoch_order, phases_of, rate_at
from pavetwin.training.trainer.self_training import MeanTeacher
from pavetwin.training.trainer.targets import Targets
from pavetwin.training.trainer.trained_part import check_frozen, trained_part
from pavetwin.training.trainer.validate import validate

SAVE_S: Final = 300.0
"""Between two checkpoints within an epoch."""

NORM_MOMENTUM: Final = 0.03
"""Of the running statistics of batch normalisation. In the first steps it is greater, so that what they begin with is
forgotten at once."""

LONGEST_GRADIENT: Final = 10.0
"""Gradients are scaled down to this length."""

VALIDATED: Final = ("val",)
"""Splits whose pictures a processor shows."""

MEASURED_VIEWS: Final = 320
"""Training views on which the normalisations of an exported model are measured."""

FITNESS: Final = (0.1, 0.9)
"""Weights of mAP@0.5 and mAP@0.5:0.95 in what is best, as published for YOLOv8."""

PARTS: Final = ("box", "classes", "distribution", "subtype", "mask")

SUMS: Final = (*PARTS, "total", TAUGHT)
"""What is averaged over the steps of an epoch."""


Photographs = Sequence[Tensor] | None
"""Views without labels as they are, and varied; None in a step without any."""


class Watcher(Protocol):
    """Is told how a training goes."""

    def on_start(self, where: str) -> None:
        """The steps begin; `where` is a sentence on the device, its precision, and who draws the views."""

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done. `epoch` counts from 0, `step` from 1."""

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done; the curves have its row last."""


@dataclass(slots=True)
class _Progress:
    """Where a run stands."""

    phase: int = 0
    epoch: int = 0
    step: int = 0
    """Steps done in the epoch."""
    sums: list[float] = field(default_factory=lambda: [0.0] * len(SUMS))
    """Of the losses over these steps."""
    best: float = -1.0
    """Fitness of the best weights of this stage."""
    best_epoch: int = -1
    curves: Curves = field(default_factory=list)


class Trainer:
    """One run: new, or continued."""

    def __init__(
        self,
        sets: Sequence[ExampleSet],
        folder: Path,
        options: TrainingOptions,
        machine: TrainingMachine,
        watcher: Watcher,
        start: Path | None = None,
        photographs: ExampleSet | None = None,
    ) -> None:
        """Args:
        start: weights to begin with, or an exported model.
        photographs: without labels; given where `options.adaptations` names a setting, and only there.

        Raises:
            PaveTwinError: the data, the folder or the weights do not fit; nothing has been changed then.
        """
        self._device = device_of(machine)
        check_compiler(machine, self._device)
        members = [(data, example) for data in sets for example in data.examples]
        training = [each for each in members if each[1].split == "train"]
        is_drawn_there = draws_views(training, options, machine, self._device)
        held = held_sets(sets, machine, VALIDATED if is_drawn_there else SPLITS_USED)
        shown = [(data, example) for data in held for example in data.examples]
        self._validation = [each for each in shown if each[1].split == "val"]
        if not is_drawn_there:
            training = [each for each in shown if each[1].split == "train"]
        check_labels(training, self._validation, options)
        check_photographs(training, photographs, options)
        self._options, self._machine, self._watcher = options, machine, watcher
        self._known = {
            # Of a source that only validates, what it labels there.
            **labelled_classes(example for _, example in self._validation),
            **labelled_classes(example for _, example in training),
        }
        self._phases = phases_of(training, options)
        torch.backends.cudnn.deterministic = True
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(options.seed)
            self.network = DetectorNetwork(options.architecture)
        self._random = load_weights(self.network, start) if start is not None else frozenset[str]()
        check_frozen(options, has_start=start is not None, random=self._random)
        self.network.to(device=self._device, memory_format=torch.channels_last)
        self._compiled = torch.compile(self.network.maps, dynamic=False) if machine.compiled else self.network.maps
        self._half = machine.half and has_half(self._device)
        self._is_new = start is None
        self._start = sha256(start.read_bytes()).hexdigest() if start is not None else None
        self._folder = RunFolder(folder)
        settings = {
            "options": options.as_mapping(),
            "data": [each.fingerprint for each in sets],
            "start": start.name if start is not None else None,
            "start_sha256": self._start,
        }
        self._teacher: MeanTeacher | None = None
        if photographs is not None:
            settings["photographs"] = photographs.fingerprint
            if options.teacher_weight:
                (unlabelled,) = held_sets([photographs], machine, SPLITS_USED)
                held = [*held, unlabelled]
                known = frozenset[int]().union(*labelled_classes(example for _, example in training).values())
                self._teacher = MeanTeacher(unlabelled, options, known)
        self._photometric = photometrics(photographs, options)
        self._pictures = DevicePictures(training, self._device) if is_drawn_there else None
        self._folder.claim(settings, TrainingOptions().as_mapping())
        if machine.workers:
            for each in held:
                if isinstance(each, HeldExampleSet):
                    each.hold(machine.workers)
        self._progress = _Progress()
        if start is not None and is_exported(start) and not self._folder.has_checkpoint:
            self._measure()
        self._begin(self._phases[0])
        self._resume()

    def run(self, stop_after_s: float | None = None) -> bool:
        """Train to the end, or until the time is up.

        Returns:
            Whether the run is finished; otherwise the same call goes on from where it stopped.

        Raises:
            PaveTwinError: a loss is not finite; the last checkpoint stays as it is.
        """
        deadline = time.monotonic() + stop_after_s if stop_after_s is not None else float("inf")
        if self._progress.phase < len(self._phases):
            self._watcher.on_start(self._where())
        while self._progress.phase < len(self._phases):
            if not self._epoch(deadline):
                self._save()
                return False
            self._close_epoch()
            self._save()
        return True

    @property
    def curves(self) -> Curves:
        """A row for each epoch so far."""
        return self._progress.curves

    @property
    def best_map50(self) -> float:
        """mAP@0.5 of the best weights so far, on the validation images."""
        return self._folder.best_map50

    def _where(self) -> str:
        precision = "bfloat16" if self._half else "single precision"
        workers = self._machine.workers
        processes = f"{workers} process{'es' if workers > 1 else ''}" if workers else "this process"
        drawn = f"{self._device}, labels are made by {processes}" if self._pictures is not None else processes
        return f"Training on {self._device} in {precision}; views are drawn by {drawn}."

    def _measure(self) -> None:
        """Give the normalisations of an exported model the statistics of the first epoch's views."""
        phase, key = self._phases[0], (self._options.seed, 0, 0)
        order = epoch_order(phase, key)[:MEASURED_VIEWS]
        views = self._views(phase, order, key)
        shown = batches(views, self._options.batch, workers=self._machine.workers)
        measure_normalisations(self.network, shown, self._pictures, self._random)

    def _views(self, phase: Phase, order: Sequence[int], key: tuple[int, int, int]) -> TrainingViews:
        """What an epoch shows; `key` is seed, phase and epoch."""
        options = self._options
        has_mosaic = not phase.classifier and key[2] < phase.epochs - options.mosaic_off
        return TrainingViews(
            phase.members,
            order,
            self._known,
            options.views(mosaic=has_mosaic),
            options.architecture.mask_px,
            key,
            self._photometric,
            self._pictures.rows if self._pictures is not None else None,
        )

    def _begin(self, phase: Phase) -> None:
        """A fresh optimiser and moving average, over what the phase trains."""
        self._trained = trained_part(self.network, phase, self._options, self._random)
        decayed = [each for each in self._trained.weights if each.ndim > 1]
        others = [each for each in self._trained.weights if each.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": self._options.weight_decay}, {"params": others}]
        self._optimiser = torch.optim.AdamW(groups, lr=self._options.rate, weight_decay=0.0)
        self._average = MovingAverage(self.network, self._options)

    def _resume(self) -> None:
        state = self._folder.load(self._device)
        if state is None:
            return
        try:
            self._progress = _Progress(**state["progress"], curves=state["curves"])
            # Checkpoints of runs without a teacher were written without its sum.
            self._progress.sums += [0.0] * (len(SUMS) - len(self._progress.sums))
            self._begin(self._phases[min(self._progress.phase, len(self._phases) - 1)])
            self.network.load_state_dict(state["network"])
            self._average.network.load_state_dict(state["average"])
            self._average.steps = state["average_steps"]
            self._optimiser.load_state_dict(state["optimiser"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise PaveTwinError(
                f"The checkpoint in '{self._folder.path}' is of another architecture or version; "
                "choose another folder, or remove it."
            ) from error

    def _save(self) -> None:
        it = self._progress
        self._folder.save(
            {
                "progress": {
                    "phase": it.phase,
                    "epoch": it.epoch,
                    "step": it.step,
                    "sums": it.sums,
                    "best": it.best,
                    "best_epoch": it.best_epoch,
                },
                "curves": it.curves,
                "network": self.network.state_dict(),
                "average": self._average.network.state_dict(),
                "average_steps": self._average.steps,
                "optimiser": self._optimiser.state_dict(),
            }
        )

    def _epoch(self, deadline: float) -> bool:
        """The steps that are left of the epoch; False when the time is up before its end."""
        it, options = self._progress, self._options
        phase = self._phases[it.phase]
        key = (options.seed, it.phase, it.epoch)
        views = self._views(phase, epoch_order(phase, key), key)
        steps = max(1, len(views) // options.batch)
        warmup = round(options.warmup_epochs * steps)
        saved = time.monotonic()
        labelled = batches(views, options.batch, first=it.step, workers=self._machine.workers)
        for batch, photographs in zip(labelled, self._taught(phase, key, steps), strict=True):
            rate = rate_at(it.epoch * steps + it.step, phase.epochs * steps, warmup, options)
            parts = self._step(batch, phase, rate, photographs)
            it.sums = [total + each for total, each in zip(it.sums, parts, strict=True)]
            it.step += 1
            self._watcher.on_step(phase, it.epoch, it.step, steps, parts[SUMS.index("total")])
            if it.step < steps and time.monotonic() > deadline:
                return False
            if time.monotonic() > saved + SAVE_S:
                self._save()
                saved = time.monotonic()
        return True

    def _taught(self, phase: Phase, key: tuple[int, ...], steps: int) -> Iterator[Photographs]:
        """The photographs of the steps that are left of the epoch."""
        it, teacher = self._progress, self._teacher
        is_early = not it.phase and it.epoch < self._options.teacher_after
        if teacher is None or phase.classifier or is_early:
            return repeat(None, steps - it.step)
        return teacher.views(key, steps, it.step, self._machine.workers)

    def _step(self, batch: Batch, phase: Phase, rate: float, photographs: Photographs) -> list[float]:
        """The losses of a batch, as `SUMS` names them; the weights have moved."""
        self._trained.begin_step()
        momentum = (
            max(NORM_MOMENTUM, 1 / (1 + self._average.steps))
            if self._is_new and not self._progress.phase
            else NORM_MOMENTUM
        )
        for each in self.network.modules():
            if isinstance(each, nn.BatchNorm2d):
                each.momentum = momentum
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        losses, taught = self._losses(batch, phase, photographs)
        total = losses.total(self._options.weights)
        if photographs is not None:
            total = total + self._options.teacher_weight * taught
        values = torch.stack([*(getattr(losses, name) for name in PARTS), total, taught]).tolist()
        if not all(map(isfinite, values)):
            told = ", ".join(f"{name} {value:.3g}" for name, value in zip(SUMS, values, strict=True))
            where = f"phase '{phase.name}', epoch {self._progress.epoch + 1}, step {self._progress.step + 1}"
            raise PaveTwinError(
                f"A loss is not finite ({where}: {told}); the last checkpoint is kept. Try a smaller `rate` in a new "
                "folder."
            )
        self._optimiser.zero_grad(set_to_none=True)
        if total.requires_grad:
            total.backward()
            nn.utils.clip_grad_norm_(self._trained.weights, LONGEST_GRADIENT)
            self._optimiser.step()
        self._average.update(self.network)
        return values

    def _losses(self, batch: Batch, phase: Phase, photographs: Photographs) -> tuple[Losses, Tensor]:
        """Of the labelled images, and of the photographs that the teacher labels."""
        targets = batch.targets.to(self._device)
        images = self._seen(images_of(batch.images, self._device, self._pictures), targets)
        has_regions = self._trained.has_regions and len(targets.regions) > 0
        nothing = torch.zeros((), device=self._device)
        box = classes = distribution = subtype = mask = taught = nothing
        with torch.autocast(self._device.type, dtype=torch.bfloat16, enabled=self._half):
            if photographs is not None and self._teacher is not None:
                # Together, so that batch normalisation learns the statistics of what it will be used on.
                plain, varied = (images_of(each, self._device) for each in photographs)
                said = self._teacher.targets(self._average.network, plain)
                both = self._encode(torch.cat([images, varied]), phase)
                encoded, theirs = both.images(slice(len(images))), both.images(slice(len(images), None))
                taught = self._teacher.loss(self.network, theirs, said, self._options.weights)
            else:
                encoded = self._encode(images, phase)
            if has_regions:
                logits, masks = self.network.regions(encoded.maps, targets.regions)
        if not phase.classifier:
            box, classes, distribution = detection_losses(encoded, targets)
        if has_regions:
            subtype = subtype_loss(logits, targets.subtypes)
            if masks is not None and self._options.mask_weight:
                mask = mask_loss(masks, targets.masks, targets.has_mask)
        return Losses(box, classes, distribution, subtype, mask), taught

    def _seen(self, images: Tensor, targets: Targets) -> Tensor:
        """The images of this step as the network sees them."""
        it, options = self._progress, self._options
        if not options.distractors:
            return images
        rng = child(options.seed, Stream.DISTRACTORS, it.phase, it.epoch, it.step)
        return with_distractors(images, targets, options.distractors, rng).to(memory_format=torch.channels_last)

    def _encode(self, images: Tensor, phase: Phase) -> Encoded:
        if phase.classifier:
            return self.network(images)
        # While the momentum changes, each step would be compiled again.
        is_settled = self._average.steps * NORM_MOMENTUM > 1
        maps = self._compiled if is_settled or not self._is_new else self.network.maps
        return self.network.encoded(images, *maps(images))

    def _close_epoch(self) -> None:
        """Validate, keep the best, and step to the next epoch or phase."""
        it, phase = self._progress, self._phases[self._progress.phase]
        precision = self._validate()
        means = dict(zip(SUMS, (total / max(1, it.step) for total in it.sums), strict=True))
        if self._teacher is None:
            del means[TAUGHT]
        each = [None if np.isnan(row[0]) else float(row[0]) for row in precision]
        result, strict = float(np.nanmean(precision[:, 0])), float(np.nanmean(precision))
        fitness = FITNESS[0] * result + FITNESS[1] * strict
        it.curves.append(
            {
                "phase": phase.name,
                "epoch": it.epoch + 1,
                "rate": self._optimiser.param_groups[0]["lr"],
                **means,
                "map50": result,
                "map": strict,
                **dict(zip(CLASSES, each, strict=True)),
            }
        )
        if fitness > it.best:
            it.best, it.best_epoch = fitness, it.epoch
            told = {
                "map50": result,
                "map": strict,
                "phase": phase.name,
                "epoch": it.epoch + 1,
                "options": self._options.as_mapping(),
                "start": self._start,
            }
            self._folder.save_best(self._average.network, told)
        self._watcher.on_epoch(it.curves)
        it.epoch, it.step, it.sums = it.epoch + 1, 0, [0.0] * len(it.sums)
        if it.epoch >= phase.epochs or it.epoch - 1 - it.best_epoch >= self._options.patience:
            self._next_phase()

    def _next_phase(self) -> None:
        """From the best weights so far. The heads of regions start from what the detector has reached: its result stays
        the one to beat; a new stage of the detector is judged by itself."""
        it = self._progress
        it.phase, it.epoch, it.best_epoch = it.phase + 1, 0, -1
        if it.phase == len(self._phases):
            return
        load_weights(self.network, self._folder.path / BEST)
        if not self._phases[it.phase].classifier:
            it.best = -1.0
        self._begin(self._phases[it.phase])

    def _validate(self) -> Any:
        options = self._options
        views = ValidationViews(
            self._validation, self._known, options.views(mosaic=False), options.architecture.mask_px
        )
        found = batches(views, options.batch, workers=self._machine.workers, whole=False)
        return validate(self._average.network, found, self._device)

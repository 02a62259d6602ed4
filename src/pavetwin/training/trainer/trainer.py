"""The training loop: its device, its progress reports, and phases, epochs and steps from the last checkpoint."""

import os
import shlex
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.training.datasets.examples import SPLITS_USED, ExampleSet, labelled_classes, missing_classes
from pavetwin.training.network.losses import Losses, detection_losses, mask_loss, subtype_loss
from pavetwin.training.network.network import DetectorNetwork, Encoded
from pavetwin.training.trainer.batches import Batch, TrainingViews, ValidationViews, batches, validate
from pavetwin.training.trainer.exported import is_exported, measure_normalisations
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.pictures import (
    GIGABYTE,
    DevicePictures,
    HeldExampleSet,
    images_of,
    is_inherited,
    room_of,
)
from pavetwin.training.trainer.run_folder import BEST, Curves, RunFolder, load_weights
from pavetwin.training.trainer.schedule import (
    MovingAverage,
    Phase,
    epoch_order,
    phases_of,
    rate_at,
    set_modes,
    train_part,
)
from pavetwin.training.trainer.views import Member

PICTURES_SHARE: Final = 0.25
"""Maximum share of a graphics card's free memory for training images, if views are drawn there by default."""

HALF_INSTRUCTIONS: Final = ("amx_bf16", "avx512_bf16")
"""Processor instructions that multiply bfloat16 faster than single precision, in `torch.cpu.get_capabilities`."""

_CPP_COMPILERS: Final = {"darwin": "clang++", "win32": "cl"}
"""Compiler that `torch.compile` starts unless CXX names one; on other systems it is g++."""


def draws_views(
    training: Sequence[Member], options: TrainingOptions, machine: TrainingMachine, device: torch.device
) -> bool:
    """Return whether the device holds the training images and draws the views.

    Raises:
        PaveTwinError: this is requested, and the device has too little memory.
    """
    if machine.views == "processor":
        return False
    if device.type != "cuda":
        return machine.views == "device"
    free, _ = torch.cuda.mem_get_info(device)
    needed = room_of(training, options.image_px)
    if machine.views == "device":
        if needed > free:
            raise PaveTwinError(
                f"`views` device: the pictures and the drawing take {needed / GIGABYTE:.1f} GB, and {device} has "
                f"{free / GIGABYTE:.1f} free; leave `views` out."
            )
        return True
    return needed <= free * PICTURES_SHARE


def check_compiler(machine: TrainingMachine, device: torch.device) -> None:
    """Check for the compiler that `torch.compile` needs: C++ for a processor, C for a graphics card.

    Raises:
        PaveTwinError: compilation is requested, and there is no compiler.
    """
    variable, names = "CXX", [_CPP_COMPILERS.get(sys.platform, "g++")]
    if device.type == "cuda":
        variable, names = "CC", ["gcc", "clang"]
    wanted = shlex.split(os.environ.get(variable, ""))[:1] or names
    if machine.compiled and not any(map(shutil.which, wanted)):
        raise PaveTwinError(
            f"`compiled`: it needs a compiler ({', '.join(wanted)}), and there is none; install one, name it in "
            f"{variable}, or leave `compiled` out."
        )


def held_sets(sets: Sequence[ExampleSet], machine: TrainingMachine, splits: Sequence[str]) -> Sequence[ExampleSet]:
    """The datasets with decoded images of some splits kept in memory.

    Worker processes end with each epoch and lose what they keep. So forked workers inherit the images from this
    process, and other workers keep none.
    """
    if machine.workers and not is_inherited():
        return sets
    return [HeldExampleSet.of(each, round(machine.held_gb * GIGABYTE), splits) for each in sets]


def device_of(machine: TrainingMachine) -> torch.device:
    """Device of the training.

    Raises:
        PaveTwinError: it does not exist.
    """
    try:
        device = torch.device(machine.device or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise PaveTwinError(f"`device`: '{machine.device}' cannot be used here.") from error
    return device


def has_half(device: torch.device) -> bool:
    """Return whether bfloat16 is faster than single precision: on most graphics cards, and on processors with AMX or
    AVX-512 BF16."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    capabilities = getattr(torch.cpu, "get_capabilities", None)  # missing in some versions
    return device.type == "cpu" and capabilities is not None and any(map(capabilities().get, HALF_INSTRUCTIONS))


LINE_S = 30.0  # Seconds between two lines within an epoch


class Watcher(Protocol):
    """Receiver of progress reports."""

    def on_start(self, where: str) -> None:
        """Training starts; `where` is a sentence on the device, its precision, and the place where views are drawn."""

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done. `epoch` counts from 0, `step` from 1; `total` is the loss."""

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done; its row is the last of the curves."""


class Silent(Watcher):
    """A watcher that ignores all reports."""


class PlainLines(Watcher):
    """Lines on the error stream, for each epoch and every half minute."""

    def __init__(self) -> None:
        self._last_s = self._began_s = time.monotonic()

    def on_start(self, where: str) -> None:
        self._write(where)

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        if time.monotonic() > self._last_s + LINE_S:
            self._write(f"{phase.name}: epoch {epoch + 1}/{phase.epochs}, step {step}/{steps}, loss {total:.3f}")

    def on_epoch(self, curves: Curves) -> None:
        self._write(line_of(curves))

    def _write(self, text: str) -> None:
        self._last_s = time.monotonic()
        sys.stderr.write(f"{self._last_s - self._began_s:7.0f} s  {text}\n")
        sys.stderr.flush()


def line_of(curves: Curves) -> str:
    """Summary of the last epoch in one line."""
    row = curves[-1]
    return (
        f"{row['phase']}: epoch {row['epoch']}, loss {row['total']:.3f}, "
        f"mAP@0.5 {row['map50']:.3f}, mAP@0.5:0.95 {row['map']:.3f}"
    )


SAVE_S: Final = 300.0  # Seconds between two checkpoints within an epoch

NORM_MOMENTUM: Final = 0.03
"""Momentum of the running statistics of batch normalisation. It is greater in the first steps, to forget the initial
values quickly."""

LONGEST_GRADIENT: Final = 10.0  # Maximum length of the gradient; longer ones are scaled down
VALIDATED: Final = ("val",)  # Splits whose views the processor draws if the device draws those of the training
MEASURED_VIEWS: Final = 320  # Number of training views on which the normalisations of an exported model are measured

FITNESS: Final = (0.1, 0.9)
"""Weights of mAP@0.5 and mAP@0.5:0.95 in the selection of the best epoch, as published for YOLOv8."""

PARTS: Final = ("box", "classes", "distribution", "subtype", "mask")

SUMS: Final = (*PARTS, "total")  # Losses that are averaged over the steps of an epoch


@dataclass(slots=True)
class _Progress:
    """State of a run between two steps."""

    phase: int = 0
    epoch: int = 0
    step: int = 0
    """Completed steps of the epoch."""
    sums: list[float] = field(default_factory=lambda: [0.0] * len(SUMS))
    """Sums of the losses over these steps."""
    best: float = -1.0
    """Fitness of the best weights of this stage."""
    best_epoch: int = -1
    curves: Curves = field(default_factory=list)


class Trainer:
    """A new or continued run."""

    def __init__(
        self,
        sets: Sequence[ExampleSet],
        folder: Path,
        options: TrainingOptions,
        machine: TrainingMachine,
        watcher: Watcher,
        start: Path | None = None,
    ) -> None:
        """Args:
        start: initial weights, or an exported model.

        Raises:
            PaveTwinError: the data, the folder or the weights are unsuitable; nothing is changed then.
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
        _check_labels(training, self._validation, options)
        self._options, self._machine, self._watcher = options, machine, watcher
        self._known = {
            # Training labels take precedence over those of a source's validation images.
            **labelled_classes(example for _, example in self._validation),
            **labelled_classes(example for _, example in training),
        }
        self._phases = phases_of(training, options)
        torch.backends.cudnn.deterministic = True
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(options.seed)
            self.network = DetectorNetwork(options.architecture)
        if start is not None:
            load_weights(self.network, start)
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
        self._pictures = DevicePictures(training, self._device) if is_drawn_there else None
        self._folder.claim(settings)
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
            Whether the run is finished; otherwise another call continues it.

        Raises:
            PaveTwinError: a loss is not finite; the last checkpoint is kept.
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
        """A row for each completed epoch."""
        return self._progress.curves

    @property
    def best_map50(self) -> float:
        """mAP@0.5 of the best weights on the validation images."""
        return self._folder.best_map50

    def _where(self) -> str:
        precision = "bfloat16" if self._half else "single precision"
        workers = self._machine.workers
        processes = f"{workers} process{'es' if workers > 1 else ''}" if workers else "this process"
        drawn = f"{self._device}, labels are made by {processes}" if self._pictures is not None else processes
        return f"Training on {self._device} in {precision}; views are drawn by {drawn}."

    def _measure(self) -> None:
        """Set the normalisations of an exported model to the statistics of views of the first epoch."""
        phase, key = self._phases[0], (self._options.seed, 0, 0)
        order = epoch_order(phase, key)[:MEASURED_VIEWS]
        views = self._views(phase, order, key)
        shown = batches(views, self._options.batch, workers=self._machine.workers)
        measure_normalisations(self.network, shown, self._pictures)

    def _views(self, phase: Phase, order: Sequence[int], key: tuple[int, int, int]) -> TrainingViews:
        """Views of an epoch; `key` is seed, phase and epoch."""
        options = self._options
        has_mosaic = not phase.classifier and key[2] < phase.epochs - options.mosaic_off
        return TrainingViews(
            phase.members,
            order,
            self._known,
            options.views(mosaic=has_mosaic),
            options.architecture.mask_px,
            key,
            self._pictures.rows if self._pictures is not None else None,
        )

    def _begin(self, phase: Phase) -> None:
        """Create the optimiser and the moving average of a phase."""
        self._weights = train_part(self.network, phase)
        decayed = [each for each in self._weights if each.ndim > 1]
        others = [each for each in self._weights if each.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": self._options.weight_decay}, {"params": others}]
        self._optimiser = torch.optim.AdamW(groups, lr=self._options.rate, weight_decay=0.0)
        self._average = MovingAverage(self.network, self._options)

    def _resume(self) -> None:
        state = self._folder.load(self._device)
        if state is None:
            return
        try:
            self._progress = _Progress(**state["progress"], curves=state["curves"])
            self._begin(self._phases[min(self._progress.phase, len(self._phases) - 1)])
            self.network.load_state_dict(state["network"])
            self._average.network.load_state_dict(state["average"])
            self._average.steps = state["average_steps"]
            self._optimiser.load_state_dict(state["optimiser"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise PaveTwinError(
                f"The checkpoint in '{self._folder.path}' is of another architecture; choose another folder."
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
        """Make the remaining steps of the epoch; return False if the time is up before its end."""
        it, options = self._progress, self._options
        phase = self._phases[it.phase]
        key = (options.seed, it.phase, it.epoch)
        views = self._views(phase, epoch_order(phase, key), key)
        steps = max(1, len(views) // options.batch)
        warmup = round(options.warmup_epochs * steps)
        saved = time.monotonic()
        for batch in batches(views, options.batch, first=it.step, workers=self._machine.workers):
            rate = rate_at(it.epoch * steps + it.step, phase.epochs * steps, warmup, options)
            parts = self._step(batch, phase, rate)
            it.sums = [total + each for total, each in zip(it.sums, parts, strict=True)]
            it.step += 1
            self._watcher.on_step(phase, it.epoch, it.step, steps, parts[SUMS.index("total")])
            if it.step < steps and time.monotonic() > deadline:
                return False
            if time.monotonic() > saved + SAVE_S:
                self._save()
                saved = time.monotonic()
        return True

    def _step(self, batch: Batch, phase: Phase, rate: float) -> list[float]:
        """Update the weights by one batch and return its losses in the order of `SUMS`."""
        set_modes(self.network)
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
        losses = self._losses(batch, phase)
        total = losses.total(self._options.weights)
        values = torch.stack([*(getattr(losses, name) for name in PARTS), total]).tolist()
        if not all(map(isfinite, values)):
            stated = ", ".join(f"{name} {value:.3g}" for name, value in zip(SUMS, values, strict=True))
            where = f"phase '{phase.name}', epoch {self._progress.epoch + 1}, step {self._progress.step + 1}"
            raise PaveTwinError(
                f"A loss is not finite ({where}: {stated}); the last checkpoint is kept. Try a smaller `rate` in a new "
                "folder."
            )
        self._optimiser.zero_grad(set_to_none=True)
        if total.requires_grad:
            total.backward()
            nn.utils.clip_grad_norm_(self._weights, LONGEST_GRADIENT)
            self._optimiser.step()
        self._average.update(self.network)
        return values

    def _losses(self, batch: Batch, phase: Phase) -> Losses:
        targets = batch.targets.to(self._device)
        images = images_of(batch.images, self._device, self._pictures)
        has_regions = len(targets.regions) > 0
        box = classes = distribution = subtype = mask = torch.zeros((), device=self._device)
        with torch.autocast(self._device.type, dtype=torch.bfloat16, enabled=self._half):
            encoded = self._encode(images, phase)
            if has_regions:
                logits, masks = self.network.regions(encoded.maps, targets.regions)
        if not phase.classifier:
            box, classes, distribution = detection_losses(encoded, targets)
        if has_regions:
            subtype = subtype_loss(logits, targets.subtypes)
            if masks is not None and self._options.mask_weight:
                mask = mask_loss(masks, targets.masks, targets.has_mask)
        return Losses(box, classes, distribution, subtype, mask)

    def _encode(self, images: Tensor, phase: Phase) -> Encoded:
        if phase.classifier:
            return self.network(images)
        # A changing momentum would cause a new compilation in each step.
        is_settled = self._average.steps * NORM_MOMENTUM > 1
        maps = self._compiled if is_settled or not self._is_new else self.network.maps
        return self.network.encoded(images, *maps(images))

    def _close_epoch(self) -> None:
        """Validate, keep the best weights, and move on to the next epoch or phase."""
        it, phase = self._progress, self._phases[self._progress.phase]
        precision = self._validate()
        means = dict(zip(SUMS, (total / max(1, it.step) for total in it.sums), strict=True))
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
                **dict(zip(CLASS_LABELS, each, strict=True)),
            }
        )
        if fitness > it.best:
            it.best, it.best_epoch = fitness, it.epoch
            facts = {
                "map50": result,
                "map": strict,
                "phase": phase.name,
                "epoch": it.epoch + 1,
                "options": self._options.as_mapping(),
                "start": self._start,
            }
            self._folder.save_best(self._average.network, facts)
        self._watcher.on_epoch(it.curves)
        it.epoch, it.step, it.sums = it.epoch + 1, 0, [0.0] * len(it.sums)
        if it.epoch >= phase.epochs or it.epoch - 1 - it.best_epoch >= self._options.patience:
            self._next_phase()

    def _next_phase(self) -> None:
        """Begin the next phase with the best weights.

        Training of the heads of regions has to exceed the fitness reached before; a new stage of the detector starts
        a new comparison.
        """
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


def _check_labels(training: Sequence[Member], validation: Sequence[Member], options: TrainingOptions) -> None:
    """Raises:
    PaveTwinError: images to train on or to validate with are missing, or a class has no object.
    """
    for name, members in (("train", training), ("val", validation)):
        if not members:
            raise PaveTwinError(f"The datasets have no images in their split '{name}'; split them with both.")
    if not any(not each.is_ignored for _, example in validation for each in example.objects):
        raise PaveTwinError("The validation images have no labelled object, which a selection of weights needs.")
    missing = missing_classes(example for _, example in training)
    if absent := [name for name in missing if name not in options.without_classes]:
        names = ", ".join(absent)
        raise PaveTwinError(
            f"No training image shows a labelled {names}; add a dataset that has some, or leave them out "
            f"(`without` '{','.join(absent)}')."
        )

"""Phases of a run, the weights that each trains, the learning rate, and the moving average of the weights."""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import cos, exp, pi

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.training.trainer.options import TrainingOptions
from pavetwin.training.trainer.views import Member


@dataclass(frozen=True, slots=True)
class Phase:
    """Part of a run with its own data and learning rate schedule."""

    name: str
    members: tuple[Member, ...]
    """Images of every epoch, followed by those to draw from."""
    main: int
    """Number of images in every epoch."""
    drawn: int
    """Number of images that every epoch draws from the rest."""
    epochs: int
    classifier: bool
    """True if only the heads of regions are trained."""


def phases_of(members: Sequence[Member], options: TrainingOptions) -> list[Phase]:
    """Phases of a run, in order. Data of one kind, photographs or synthetic images, have one stage.

    Raises:
        PaveTwinError: images that the order needs are missing.
    """
    real = [each for each in members if not each[1].is_synthetic]
    synthetic = [each for each in members if each[1].is_synthetic]
    kinds = {"real": real, "synthetic": synthetic}
    order = options.order
    if order in kinds and not kinds[order]:
        what = "photographs" if order == "real" else "synthetic images"
        raise PaveTwinError(f"`order` {order}: the datasets have no {what} to train on.")
    if not real or not synthetic:
        stages: list[tuple[str, list[Member], list[Member]]] = [("all", list(members), [])]
    elif order in kinds:
        stages = [(order, kinds[order], [])]
    elif order == "mixed":
        stages = [("mixed", synthetic, real)]
    else:
        first, second = order.split("-")
        stages = [(first, kinds[first], []), (second, kinds[second], kinds[first])]
        stages = stages[options.skip_first :]
    phases = [_phase(name, main, others, options) for name, main, others in stages if options.epochs]
    if options.classifier_epochs:
        name, main, others = stages[-1]
        phases.append(_phase(f"{name}, classifier", main, others, options, classifier=True))
    if not phases:
        raise PaveTwinError("`epochs` and `classifier_epochs` are both 0: there is nothing to train.")
    return phases


def _phase(
    name: str, main: list[Member], others: list[Member], options: TrainingOptions, *, classifier: bool = False
) -> Phase:
    if options.native:
        main = [each for each in main for _ in range(_crops(each, options.image_px))]
    main = main * options.repeats
    drawn = round(len(main) * options.replay / (1 - options.replay)) if others else 0
    epochs = options.classifier_epochs if classifier else options.epochs
    return Phase(name, (*main, *others), len(main), drawn, epochs, classifier)


def _crops(member: Member, size_px: int) -> int:
    """Crops of an image in an epoch, about as many as cover it once."""
    width, height = member[1].size_px
    return max(1, round(width * height / size_px**2))


def epoch_order(phase: Phase, key: tuple[int, ...]) -> list[int]:
    """Shuffled indices of an epoch's members; every image to draw from is drawn once before any is drawn twice.

    Args:
        key: seed, phase and epoch.
    """
    seed, *keys = key
    rng = child(seed, Stream.TRAINING, *keys)
    others = len(phase.members) - phase.main
    drawn: list[int] = []
    while len(drawn) < phase.drawn:
        drawn += (phase.main + rng.permutation(others)).tolist()
    order = np.array([*range(phase.main), *drawn[: phase.drawn]])
    return [int(each) for each in rng.permutation(order)]


def rate_at(step: int, steps: int, warmup: int, options: TrainingOptions) -> float:
    """Learning rate of a step: a linear rise, then a cosine decay.

    Args:
        steps: number of steps of the phase.
        warmup: number of steps in which the rate rises.
    """
    if step < warmup:
        return options.rate * (step + 1) / warmup
    share = (step - warmup) / max(1, steps - warmup)
    low = options.final_rate
    return options.rate * (low + (1 - low) * (1 + cos(pi * share)) / 2)


def train_part(network: nn.Module, phase: Phase) -> list[nn.Parameter]:
    """Freeze the weights that a phase does not train, and return the others.

    A phase trains the whole network, or the heads of regions.
    """
    for name, weight in network.named_parameters():
        weight.requires_grad_(not phase.classifier or name.startswith("regions."))
    return [each for each in network.parameters() if each.requires_grad]


def set_modes(network: nn.Module) -> None:
    """Put the network in training mode, except frozen normalisations, which keep their statistics."""
    network.train()
    for each in network.modules():
        own = list(each.parameters(recurse=False))
        if own and not any(weight.requires_grad for weight in own):
            each.eval()


class MovingAverage:
    """Exponential moving average of a network's weights, which is validated and kept.

    Its decay at step n is d · (1 − e^(−n/τ)).
    """

    def __init__(self, network: nn.Module, options: TrainingOptions) -> None:
        self.network = deepcopy(network).eval().requires_grad_(requires_grad=False)
        self.steps = 0
        self._decay, self._tau = options.ema_decay, options.ema_steps

    @torch.no_grad()
    def update(self, network: nn.Module) -> None:
        """Include the weights of one step."""
        self.steps += 1
        decay = self._decay * (1 - exp(-self.steps / self._tau))
        current, own = network.state_dict(), self.network.state_dict()
        names = [name for name, value in own.items() if value.is_floating_point()]
        average = get_ema_multi_avg_fn(decay)
        average([own[name] for name in names], [current[name] for name in names], None)
        for name in own.keys() - set(names):
            own[name].copy_(current[name])

"""Which weights of a network a phase of a training changes."""

from collections.abc import Collection

from torch import nn

from pavetwin.errors import PaveTwinError
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.options import TrainingOptions
from pavetwin.training.trainer.schedule import Phase


class TrainedPart:
    """The weights that change; all others keep their values, and their normalisations use the statistics they have."""

    def __init__(self, network: DetectorNetwork, names: Collection[str]) -> None:
        """Args:
        names: of parameters of the network.
        """
        self.weights: list[nn.Parameter] = []
        """In the order of the network."""
        for name, weight in network.named_parameters():
            weight.requires_grad_(name in names)
            if name in names:
                self.weights.append(weight)
        self.has_regions = any(weight.requires_grad for weight in network.regions.parameters())
        """Whether a weight of the heads of regions is among them."""
        self._network = network
        self._kept = [each for each in network.modules() if _is_kept(each)]

    def begin_step(self) -> None:
        """Set the modes of the layers."""
        self._network.train()
        for each in self._kept:
            each.eval()


def trained_part(
    network: DetectorNetwork, phase: Phase, options: TrainingOptions, random: Collection[str]
) -> TrainedPart:
    """What a phase trains: the heads of regions, what begins with random weights, or everything.

    Args:
        random: names of the weights that the run begins without.
    """
    names = [name for name, _ in network.named_parameters()]
    if phase.classifier:
        names = [name for name in names if name.startswith("regions.")]
    elif options.freeze:
        names = [name for name in names if name in random]
    return TrainedPart(network, frozenset(names))


def check_frozen(options: TrainingOptions, *, has_start: bool, random: Collection[str]) -> None:
    """Raises:
    PaveTwinError: `freeze` would keep nothing as it is, or everything.
    """
    if not options.freeze:
        return
    if not has_start:
        raise PaveTwinError("`freeze` keeps the weights that a run begins with; name some (`start`).")
    if not random:
        raise PaveTwinError(
            "`freeze` trains the level of p2=true alone, and `start` must lack it; here there is nothing left to train."
        )


def _is_kept(layer: nn.Module) -> bool:
    own = list(layer.parameters(recurse=False))
    return bool(own) and not any(weight.requires_grad for weight in own)

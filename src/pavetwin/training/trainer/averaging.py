"""The mean of the weights of several runs that began with the same weights.

Runs that go on from the same weights with other seeds end near each other, and a network with the mean of their weights
finds more than they do on average (Wortsman et al. 2022, "Model soups"). Runs that begin with random weights do not:
their mean finds nothing. Means and variances of batch normalisation are averaged too, and not measured again.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import Any

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.training.trainer.exported import is_exported
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.run_folder import BEST, SETTINGS, load_network

_SHARED = ("image_px", "native", "without")
"""Options that say how the network sees an image, and which classes it learns."""


@dataclass(frozen=True, slots=True)
class _Member:
    """One of the runs."""

    run: Path
    network: DetectorNetwork
    told: dict[str, Any]
    """What its weights say beside."""
    name: str | None
    """Of the file that it began with; None for random weights, empty where that is not known."""
    digest: str

    @property
    def start(self) -> str | None:
        """SHA-256 of what it began with; None for random weights, empty where that is not known."""
        if "start" not in self.told:
            return None if self.name is None else ""
        return None if self.told["start"] is None else str(self.told["start"])


def averaged_network(runs: Sequence[Path]) -> tuple[DetectorNetwork, dict[str, Any]]:
    """The network with the mean of the best weights of these runs, ready for use, and what the first says beside.

    Args:
        runs: folders of runs or files of weights; the network of a single one is as it is. Weights that do not say what
            they began with (of earlier versions, without the `run.json` of their run) are taken as they are.

    Raises:
        PaveTwinError: there are no weights or they are damaged; a run is given twice, has another architecture, sees
            images otherwise, learnt other classes, or did not begin with the same weights as the others.
    """
    if not runs:
        raise PaveTwinError("A mean is of runs; name one at least.")
    if len(runs) == 1:
        return load_network(weights_of(runs[0]))
    for run in runs:
        if is_exported(run):
            raise PaveTwinError(f"'{run}' is an exported model, and a mean is of runs: name their folders or best.pt.")
    members = [_member(run) for run in runs]
    first = members[0]
    for at, other in enumerate(members[1:], start=1):
        if any(other.digest == before.digest for before in members[:at]):
            raise PaveTwinError(f"'{other.run}' has the weights of a run that is given before it; leave one out.")
        if difference := other.network.architecture.difference(first.network.architecture):
            raise PaveTwinError(
                f"'{other.run}' is of another architecture than '{first.run}': {difference}; export them apart."
            )
        _check_options(other, first)
    _check_starts(members)
    states = [each.network.state_dict() for each in members]
    first.network.load_state_dict({name: _mean([state[name] for state in states]) for name in states[0]})
    return first.network.eval(), first.told


def weights_of(run: Path) -> Path:
    """The best weights of a run's folder; a file is itself."""
    return run / BEST if run.is_dir() else run


def _member(run: Path) -> _Member:
    file = weights_of(run)
    network, told = load_network(file)
    return _Member(run, network, told, _name_of_start(file.parent / SETTINGS), sha256(file.read_bytes()).hexdigest())


def _name_of_start(settings: Path) -> str | None:
    if not settings.is_file():
        return ""
    try:
        start = json.loads(settings.read_text(encoding="utf-8"))["start"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PaveTwinError(
            f"'{settings}' is damaged, so that it does not say what the run began with; leave this run out."
        ) from error
    return None if start is None else str(start)


def _mean(values: Sequence[torch.Tensor]) -> torch.Tensor:
    """Counts of steps, which are whole, are those of the first."""
    return torch.stack(list(values)).mean(dim=0) if values[0].is_floating_point() else values[0]


def _check_options(other: _Member, first: _Member) -> None:
    mine, theirs = (dict(each.told.get("options") or {}) for each in (other, first))
    for name in _SHARED:
        if mine.get(name) != theirs.get(name):
            raise PaveTwinError(
                f"'{other.run}' was trained with {name} {_said(mine, name)}, '{first.run}' with {_said(theirs, name)}; "
                "their mean would suit neither: export them apart."
            )


def _said(options: Mapping[str, Any], name: str) -> str:
    return str(options.get(name) or ("no" if name == "native" else "nothing"))


def _check_starts(members: Sequence[_Member]) -> None:
    for each in members:
        if each.start is None:
            raise PaveTwinError(
                f"'{each.run}' began with random weights: a mean with others finds nothing. "
                "Train each from the same weights with another seed: "
                "`pavetwin train DATASET output=RUN start=WEIGHTS seed=1`."
            )
    for one, other in combinations(members, 2):
        starts = (one.start, other.start) if one.start and other.start else (one.name, other.name)
        if all(starts) and starts[0] != starts[1]:
            raise PaveTwinError(
                f"'{other.run}' began with other weights ('{other.name}') than '{one.run}' ('{one.name}'); a mean is "
                "of runs that begin with the same: export them apart."
            )

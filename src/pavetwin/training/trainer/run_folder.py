"""A run on disk: its settings, its curves, the checkpoint from which it goes on, and the best weights.

- `run.json`: options, architecture and the fingerprints of the data.
- `curves.csv`: a row for each epoch.
- `checkpoint.pt`: everything, so that another machine continues to the same curve.
- `best.pt`: the moving average of the weights at the best epoch; the result of the run.
"""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.perception.classes import CLASSES
from pavetwin.training.trainer.architecture import Architecture
from pavetwin.training.trainer.exported import exported_network, is_exported
from pavetwin.training.trainer.network import DetectorNetwork

FORMAT: Final = 1
"""Of checkpoints and weights."""

CHECKPOINT: Final = "checkpoint.pt"
BEST: Final = "best.pt"
SETTINGS: Final = "run.json"
CURVES: Final = "curves.csv"

COLUMNS: Final = (
    *("phase", "epoch", "rate", "box", "classes", "distribution", "subtype", "mask", "total", "map50", "map"),
    *CLASSES,
)
"""Of the curves: mean losses of the epoch, then mean average precision of the validation images, then that at an IoU of
0.5 of each class."""

TAUGHT: Final = "taught"
"""Column of the loss on unlabelled photographs; only runs with a teacher have it."""

Curves = list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class RunFolder:
    """The files of a run."""

    path: Path

    def claim(self, settings: Mapping[str, Any], defaults: Mapping[str, Any]) -> None:
        """Write the settings of a new run, or check that a run that is there has the same.

        Args:
            defaults: of the options: what a run has that was begun before an option was there.

        Raises:
            PaveTwinError: it has others, the folder holds something else, or it cannot be written.
        """
        file = self.path / SETTINGS
        if file.is_file():
            try:
                found = json.loads(file.read_text(encoding="utf-8"))
                found["options"] = {**defaults, **found["options"]}
                # Runs of earlier versions name the file that they began with alone.
                found.setdefault("start_sha256", settings.get("start_sha256"))
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise PaveTwinError(f"'{file}' is damaged; choose another folder for the run.") from error
            if difference := _difference(found, settings):
                raise PaveTwinError(
                    f"'{self.path}' holds a run with {difference}; give what it has, or choose another folder."
                )
            return
        if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise PaveTwinError(f"'{self.path}' exists and holds no run; choose another folder.")
        with writing(file) as temporary:
            temporary.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")

    def write_curves(self, curves: Curves) -> None:
        """A row for each epoch so far."""
        with writing(self.path / CURVES) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            more = [TAUGHT] if any(TAUGHT in row for row in curves) else []
            table = csv.DictWriter(stream, [*COLUMNS, *more], lineterminator="\n")
            table.writeheader()
            table.writerows(curves)

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is something to go on from."""
        return (self.path / CHECKPOINT).is_file()

    def save(self, state: Mapping[str, Any]) -> None:
        """Write the checkpoint, and the curves up to it."""
        _save(self.path / CHECKPOINT, state)
        self.write_curves(state["curves"])

    def load(self, device: torch.device) -> dict[str, Any] | None:
        """The checkpoint; None where there is none yet.

        Raises:
            PaveTwinError: it is damaged.
        """
        return _load(self.path / CHECKPOINT, device) if self.has_checkpoint else None

    def save_best(self, network: DetectorNetwork, told: Mapping[str, Any]) -> None:
        """Write weights that can be used, with what they are of."""
        state = {
            "architecture": network.architecture.as_mapping(),
            "classes": list(CLASSES),
            "weights": network.state_dict(),
            **told,
        }
        _save(self.path / BEST, state)

    @property
    def best_map50(self) -> float:
        """What `best.pt` says of itself: its mAP@0.5 on the validation images.

        Raises:
            PaveTwinError: there is none, or it is damaged.
        """
        return float(load_network(self.path / BEST)[1]["map50"])


def load_network(path: Path, device: torch.device | str = "cpu") -> tuple[DetectorNetwork, dict[str, Any]]:
    """The network of a file of weights (`best.pt`), ready for use, and what else the file says.

    Raises:
        PaveTwinError: there is no such file, or it is damaged.
    """
    if not path.is_file():
        raise PaveTwinError(f"There is no file of weights '{path}'; a finished run has a {BEST}.")
    content = _load(path, torch.device(device))
    try:
        network = DetectorNetwork(Architecture(**content["architecture"]))
        network.load_state_dict(content.pop("weights"))
    except (KeyError, TypeError, RuntimeError) as error:
        raise PaveTwinError(f"'{path}' holds no weights of a detector of this version.") from error
    return network.to(device).eval(), content


def load_weights(network: DetectorNetwork, path: Path) -> frozenset[str]:
    """Begin with the weights of a file, or of an exported model.

    A level of stride 4 that the file lacks keeps its random weights.

    Returns:
        Names of the weights that the file lacks.

    Raises:
        PaveTwinError: there is no such file, it is damaged, or it is of another architecture.
    """
    if is_exported(path):
        other = exported_network(path)
    else:
        other, _ = load_network(path, next(network.parameters()).device)
    wanted = network.architecture
    if difference := replace(other.architecture, p2=other.architecture.p2 or wanted.p2).difference(wanted):
        raise PaveTwinError(
            f"'{path}' is of another architecture: {difference}; give what it has, or start without it."
        )
    return frozenset(network.load_state_dict(other.state_dict(), strict=other.architecture == wanted).missing_keys)


def _save(path: Path, state: Mapping[str, Any]) -> None:
    with writing(path) as temporary:
        torch.save({"format": FORMAT, **state}, temporary)


def _load(path: Path, device: torch.device) -> dict[str, Any]:
    try:
        content = torch.load(path, map_location=device, weights_only=True)
        number = content["format"]
    # What it raises of a file that is something else depends on the first bytes.
    except Exception as error:
        raise PaveTwinError(f"'{path}' is damaged, or no file of this program's.") from error
    if number != FORMAT:
        raise PaveTwinError(f"'{path}' is of format {number}, this version's is {FORMAT}.")
    return dict(content)


def _difference(found: Any, wanted: Any, name: str = "") -> str:
    """The first value in which two mappings differ, as `rate 0.1, not 0.2`; empty where they are the same."""
    if isinstance(found, Mapping) and isinstance(wanted, Mapping):
        told = (_difference(found.get(key), wanted.get(key), key) for key in {**found, **wanted})
        return next(filter(None, told), "")
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        wanted = list(wanted)
    return f"{name} {_short(found)}, not {_short(wanted)}" if found != wanted else ""


def _short(value: Any) -> str:
    text = json.dumps(value) if isinstance(value, list | dict) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"

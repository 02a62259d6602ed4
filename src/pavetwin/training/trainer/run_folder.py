"""A run on disk: settings, curves, checkpoint and best weights.

- `run.json`: options and fingerprints of the data and the initial weights.
- `curves.csv`: a row for each epoch.
- `checkpoint.pt`: the complete state, from which any machine continues to the same curve.
- `best.pt`: the moving average of the weights at the best epoch; the result of the run.
"""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, writing
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.training.network.architecture import Architecture
from pavetwin.training.network.network import DetectorNetwork
from pavetwin.training.trainer.exported import exported_model, is_exported

CHECKPOINT: Final = "checkpoint.pt"
BEST: Final = "best.pt"
SETTINGS: Final = "run.json"
CURVES: Final = "curves.csv"

COLUMNS: Final = (
    *("phase", "epoch", "rate", "box", "classes", "distribution", "subtype", "mask", "total", "map50", "map"),
    *CLASS_LABELS,
)
"""Columns of the curves: mean losses of the epoch, mean average precision on the validation images at IoU 0.5 and over
0.5 to 0.95, and average precision of each class at IoU 0.5."""

Curves = list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Files of a run."""

    path: Path

    def claim(self, settings: Mapping[str, Any]) -> None:
        """Write the settings of a new run, or check that an existing run has the same ones.

        Raises:
            PaveTwinError: they differ, the folder holds something else, or it cannot be written.
        """
        file = self.path / SETTINGS
        if file.is_file():
            try:
                found = json.loads(file.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise PaveTwinError(f"'{file}' is damaged; choose another folder for the run.") from error
            if difference := _difference(found, settings):
                raise PaveTwinError(
                    f"'{self.path}' holds a run with {difference}; use its settings, or choose another folder."
                )
            return
        if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise PaveTwinError(f"'{self.path}' exists and holds no run; choose another folder.")
        with writing(file) as temporary:
            temporary.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")

    def write_curves(self, curves: Curves) -> None:
        """Write a row for each epoch."""
        with writing(self.path / CURVES) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            table.writeheader()
            table.writerows(curves)

    @property
    def has_checkpoint(self) -> bool:
        return (self.path / CHECKPOINT).is_file()

    def save(self, state: Mapping[str, Any]) -> None:
        _save(self.path / CHECKPOINT, state)
        self.write_curves(state["curves"])

    def load(self, device: torch.device) -> dict[str, Any] | None:
        """The checkpoint, or None.

        Raises:
            PaveTwinError: it is damaged.
        """
        return _load(self.path / CHECKPOINT, device) if self.has_checkpoint else None

    def save_best(self, network: DetectorNetwork, facts: Mapping[str, Any]) -> None:
        """Write usable weights with facts about their training."""
        state = {
            "architecture": network.architecture.as_mapping(),
            "classes": list(CLASS_LABELS),
            "weights": network.state_dict(),
            **facts,
        }
        _save(self.path / BEST, state)

    @property
    def best_map50(self) -> float:
        """mAP@0.5 of `best.pt` on the validation images.

        Raises:
            PaveTwinError: the file is missing or damaged.
        """
        return float(load_network(self.path / BEST)[1]["map50"])


def load_network(path: Path, device: torch.device | str = "cpu") -> tuple[DetectorNetwork, dict[str, Any]]:
    """The network of a file of weights (`best.pt`) in `eval` mode, and the other contents of the file.

    Raises:
        PaveTwinError: the file is missing or damaged.
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


def load_weights(network: DetectorNetwork, path: Path) -> None:
    """Load the weights of a file or of an exported model.

    Raises:
        PaveTwinError: the file is missing, damaged or of another architecture.
    """
    if is_exported(path):
        other, _ = exported_model(path)
    else:
        other, _ = load_network(path, next(network.parameters()).device)
    if difference := other.architecture.difference(network.architecture):
        raise PaveTwinError(
            f"'{path}' is of another architecture: {difference}; use its settings, or start without it."
        )
    network.load_state_dict(other.state_dict())


def _save(path: Path, state: Mapping[str, Any]) -> None:
    with writing(path) as temporary:
        torch.save({"format": FORMAT, **state}, temporary)


def _load(path: Path, device: torch.device) -> dict[str, Any]:
    try:
        content = torch.load(path, map_location=device, weights_only=True)
        number = content["format"]
    # The type of the exception depends on the first bytes of the file.
    except Exception as error:
        raise PaveTwinError(f"'{path}' is damaged, or not a file of weights of PaveTwin.") from error
    check_format(number, f"'{path}'")
    return dict(content)


def _difference(found: Any, wanted: Any, name: str = "") -> str:
    """The first value in which two mappings differ, as `rate 0.1, not 0.2`; empty if they are equal."""
    if isinstance(found, Mapping) and isinstance(wanted, Mapping):
        each = (_difference(found.get(key), wanted.get(key), key) for key in {**found, **wanted})
        return next(filter(None, each), "")
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        wanted = list(wanted)
    return f"{name} {_short(found)}, not {_short(wanted)}" if found != wanted else ""


def _short(value: Any) -> str:
    text = json.dumps(value) if isinstance(value, list | dict) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"

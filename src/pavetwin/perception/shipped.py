"""Detectors that ship, by name: `Detector("rendered")`. The model card states what each finds.

`rendered` is for rendered images and missions, `photographs` for photographs.
"""

from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError

FOLDER: Final = Path(__file__).parent / "weights"

DEFAULT: Final = "rendered"
"""Detector used where none is named."""


def shipped_models() -> list[str]:
    """Names of the detectors that ship."""
    return sorted(file.stem for file in FOLDER.glob("*.onnx"))


def model_path(model: str | Path) -> Path:
    """File of a model: an ONNX file, or a detector that ships, by name. A file takes precedence.

    Raises:
        PaveTwinError: there is neither.
    """
    file = Path(model)
    if file.is_file():
        return file
    if str(model) in shipped_models():
        return FOLDER / f"{model}.onnx"
    raise PaveTwinError(
        f"There is no model '{model}': name one that ships ({', '.join(shipped_models())}), or a file of "
        f"`pavetwin export RUN --output model.onnx`."
    )


def start_path(start: str | Path) -> Path:
    """File of initial weights: `best.pt` of a run, an exported model, or a detector that ships, by name.

    Raises:
        PaveTwinError: there is none of them.
    """
    if Path(start).is_file() or str(start) in shipped_models():
        return model_path(start)
    raise PaveTwinError(
        f"`start`: there is no file of weights '{start}'; name the best.pt of a run, the file of `pavetwin export RUN "
        f"output=model.onnx`, or a model that ships ({', '.join(shipped_models())})."
    )

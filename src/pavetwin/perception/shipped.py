"""The detectors that ship, by name: `Detector("synthetic-11")`. The model card tells what they can do.

Other weights get another number, so that a name always means the same detector.
"""

from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError

FOLDER: Final = Path(__file__).parent / "weights"

DEFAULT: Final = "synthetic-11"
"""Where no model is named."""


def shipped_models() -> list[str]:
    """Their names."""
    return sorted(file.stem for file in FOLDER.glob("*.onnx"))


def model_path(model: str | Path) -> Path:
    """The file of a model: an ONNX file, or one that ships, by name. A file comes first.

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
        f"`pavetwin export RUN output=model.onnx`."
    )


def start_path(start: str | Path) -> Path:
    """What a training begins with: weights of a run, an exported model, or one that ships, by name.

    Raises:
        PaveTwinError: there is none of them.
    """
    if Path(start).is_file() or str(start) in shipped_models():
        return model_path(start)
    raise PaveTwinError(
        f"`start`: there is no file of weights '{start}'; name the best.pt of a run, the file of `pavetwin export RUN "
        f"output=model.onnx`, or a model that ships ({', '.join(shipped_models())})."
    )

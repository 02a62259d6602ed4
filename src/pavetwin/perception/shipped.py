"""The detectors that ship, by name: `Detector("synthetic-1")`. The model card tells what they can do.

Other weights get another number, so that a name always means the same detector.
"""

from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError

FOLDER: Final = Path(__file__).parent / "weights"

DEFAULT: Final = "synthetic-1"
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

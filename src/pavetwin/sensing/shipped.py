"""The fitted sensors that ship, by name: each has the name of the detector that it stands for.

A sensor is fitted again for the same detector with another name alone, so that a name always means the same sensor.
"""

import json
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.perception import model_file as shipped

FOLDER: Final = Path(__file__).parent / "fitted"

DEFAULT: Final = shipped.DEFAULT
"""Where no fitted sensor is named: that of the detector which looks where none is named."""


def shipped_sensors() -> list[str]:
    """Their names."""
    return sorted(file.stem for file in FOLDER.glob("*.json"))


def sensor_of(detector: str) -> Path | None:
    """The file of the sensor that ships and was fitted to a detector; None where there is none.

    Args:
        detector: SHA-256 of its model file.
    """
    return next((file for name in shipped_sensors() if _is_of(file := FOLDER / f"{name}.json", detector)), None)


def _is_of(file: Path, detector: str) -> bool:
    return bool(json.loads(file.read_bytes())["detector"]["sha256"] == detector)


def sensor_path(fitted: str | Path) -> Path:
    """The file of a fitted sensor: a JSON file, or one that ships, by name. A file comes first.

    Raises:
        PaveTwinError: there is neither.
    """
    file = Path(fitted)
    if file.is_file():
        return file
    if str(fitted) in shipped_sensors():
        return FOLDER / f"{fitted}.json"
    raise PaveTwinError(
        f"There is no fitted sensor '{fitted}': name one that ships ({', '.join(shipped_sensors())}), or a file of "
        f"`pavetwin sensor fit MISSIONS --output sensor.json`."
    )

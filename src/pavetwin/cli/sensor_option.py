"""What --model gives to the sensor of a mission."""

from pathlib import Path
from typing import TYPE_CHECKING

from pavetwin.cli.detect import named
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings


def model_option(file: Path) -> dict[str, str]:
    """The option of a sensor that --model sets, by the kind of its file.

    Raises:
        PaveTwinError: there is no such file.
    """
    if file.suffix != ".json":
        return {"model": str(named(file))}
    if not file.is_file():
        raise PaveTwinError(
            f"`model`: there is no file '{file}'; `pavetwin sensor fit MISSIONS output={file}` writes one."
        )
    return {"fitted": str(file)}


def check_has_model(settings: "MissionSettings") -> None:
    """Whether --model says something of the mission's sensor.

    Raises:
        PaveTwinError: the sensor takes no model.
    """
    from pavetwin.sensing.registered import sensor_class

    if "model" not in sensor_class(settings.sensing.sensor).default_options:
        raise PaveTwinError(f"--model: the sensor '{settings.sensing.sensor}' takes none; add --sensor detector.")

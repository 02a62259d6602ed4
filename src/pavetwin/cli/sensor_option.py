"""What --model gives to the sensor of a mission."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.detect import named
from pavetwin.errors import PaveTwinError, about
from pavetwin.perception.shipped import DEFAULT

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings


SensorModel = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="NAME|FILE",
        help=f"Of --sensor detector: one that ships, or a file of `pavetwin export`; {DEFAULT} unless given. "
        f"Of --sensor calibrated: one that ships, or a file of `pavetwin sensor fit`; {DEFAULT} unless given.",
    ),
]


def model_option(model: str, sensor: str) -> dict[str, str]:
    """The option of a sensor that --model sets: of `calibrated` the fitted sensor, unless it names an ONNX file.

    One that ships keeps its name, which holds on any machine.

    Raises:
        PaveTwinError: there is no such file, and none that ships has this name.
    """
    from pavetwin.perception.shipped import FOLDER
    from pavetwin.sensing.registered import sensor_class
    from pavetwin.sensing.shipped import sensor_path

    if model.endswith(".json") and not Path(model).is_file():
        raise PaveTwinError(
            f"`model`: there is no file '{model}'; `pavetwin sensor fit MISSIONS output={model}` writes one."
        )
    if model.endswith(".json") or ("fitted" in sensor_class(sensor).default_options and not model.endswith(".onnx")):
        with about("model"):
            sensor_path(model)
        return {"fitted": model}
    file = named(model)
    return {"model": file.stem if file.parent == FOLDER else str(file)}


def check_has_model(settings: "MissionSettings") -> None:
    """Whether --model says something of the mission's sensor.

    Raises:
        PaveTwinError: the sensor takes no model.
    """
    from pavetwin.sensing.registered import sensor_class

    if "model" not in sensor_class(settings.sensing.sensor).default_options:
        raise PaveTwinError(f"--model: the sensor '{settings.sensing.sensor}' takes none; add --sensor detector.")

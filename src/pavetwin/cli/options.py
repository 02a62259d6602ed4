"""Options that several commands share, and groups of options as typed values.

A group is a dataclass whose fields are options. A command under `grouped` takes groups as parameters.
"""

import datetime as dt
import inspect
import os
import re
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from copy import copy
from dataclasses import asdict, dataclass, fields, is_dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_args, get_type_hints

import typer
from typer.models import OptionInfo

from pavetwin.cli.commands import PLUGIN
from pavetwin.errors import PaveTwinError, about, naming
from pavetwin.perception.model_file import DEFAULT
from pavetwin.world.folder import CACHE_VARIABLE, check_world

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Spread the option groups among the parameters of a command into single options, in order.

    The first line of a group's docstring is the heading of its options in the help.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, type[Any]] = {}
    options: list[inspect.Parameter] = []
    for each in inspect.signature(command).parameters.values():
        kind = hints[each.name]
        if isinstance(kind, type) and is_dataclass(kind):
            groups[each.name] = kind
            options += _options_of(kind)
        else:
            options.append(each.replace(annotation=kind, kind=inspect.Parameter.KEYWORD_ONLY))

    @wraps(command)
    def spread(**values: Any) -> None:
        for name, kind in groups.items():
            values[name] = kind(**{field.name: values.pop(field.name) for field in fields(kind)})
        command(**values)

    spread.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    spread.__annotations__ = {each.name: each.annotation for each in options}
    return spread


def _options_of(group: type[Any]) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    panel = (group.__doc__ or "").partition("\n")[0].rstrip(".")
    made = []
    for field in fields(group):
        kind, option = get_args(hints[field.name])
        assert isinstance(option, OptionInfo)
        option = copy(option)
        option.rich_help_panel = panel
        made.append(
            inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=Annotated[kind, option]
            )
        )
    return made


def was_given(context: typer.Context, name: str) -> bool:
    """Whether a parameter was given on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def refuse_together(context: typer.Context, *names: str) -> None:
    """Raises:
    PaveTwinError: several of these parameters were given, of which each replaces the others.
    """
    given = [f"`{name}`" for name in names if was_given(context, name)]
    if len(given) > 1:
        raise PaveTwinError(f"{' and '.join(given)} exclude each other; give one of them.")


def existing_world(context: typer.Context, parameter: typer.CallbackParam, folder: Path | None) -> Path | None:
    """Check a world's folder before a command loads anything that takes long."""
    if folder is not None and not context.resilient_parsing:  # shell completion asks for no errors
        with about(parameter.name or "world") if parameter.param_type_name == "option" else nullcontext():
            check_world(folder)
    return folder


def _use_cache(folder: Path | None) -> Path | None:
    if folder is not None:
        os.environ[CACHE_VARIABLE] = str(folder.absolute())  # for worker processes, too
    return folder


WorldFolder = Annotated[Path, typer.Argument(help="Folder of the world.", callback=existing_world)]
DatasetFolder = Annotated[Path, typer.Argument(help="Folder of a dataset.")]
Jobs = Annotated[
    int | None,
    typer.Option(
        help="Number of processes that take images; default: one per core, as far as memory allows. With 2 or "
        "more, one further process prefetches tiles (one of these for few images). The images do not depend on it."
    ),
]
SheetFile = Annotated[
    Path | None, typer.Option("--output", "-o", help="Image file; default: contact-sheet.png in the dataset.")
]
SheetCount = Annotated[int, typer.Option("--count", help="Number of images.")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", **PLUGIN)]
"""For commands whose settings name plugins; all others load them while the command line is parsed."""

CacheFolder = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="FOLDER",
        help=f"Folder for recorded traffic and baked NavMeshes; default: {CACHE_VARIABLE} or ~/.cache/pavetwin.",
        callback=_use_cache,
    ),
]
Host = Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0 for every machine.")]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port to listen at; 0 takes a free one.")]


def check_empty(output: Path, *, force: bool) -> None:
    """Raises:
    PaveTwinError: the folder for results exists and is not empty, and `force` is not given.
    """
    if output.exists() and (not output.is_dir() or any(output.iterdir())) and not force:
        raise PaveTwinError(f"`output` '{output}' exists and is not empty; choose another folder, or add `force`.")


def paths_of(plugins: list[Path] | None) -> tuple[str, ...]:
    """The `--plugin` files as settings hold them."""
    return tuple(str(path.absolute()) for path in plugins or ())


def split_shares(text: str, parameter: str) -> tuple[float, float, float]:
    """`70/15/15` as shares of train, val and test.

    Raises:
        PaveTwinError: it has another form.
    """
    try:
        train, val, test = (float(part) / 100 for part in text.split("/"))
    except ValueError:
        raise PaveTwinError(
            f"`{parameter}` {text}: expected the percentages of train/val/test, such as 70/15/15."
        ) from None
    return train, val, test


Mix = Annotated[
    str | None,
    typer.Option("--mix", help="Vehicles: europe (default), north_america, east_asia or south_asia."),
]


def traffic_name(density: str | None, los: str | None, hour: int | None, mix: str | None) -> str | None:
    """The name of the requested traffic, as `density_named` reads it; None if no option is given.

    Raises:
        PaveTwinError: two of them exclude each other, or a name is not known.
    """
    given = {"`density`": density, "`los`": los, "`hour`": hour}
    named = [option for option, value in given.items() if value is not None]
    if len(named) > 1:
        raise PaveTwinError(f"{' and '.join(named)} exclude each other; give one of them.")
    if not named and mix is None:
        return None
    from pavetwin.traffic.demand import DEFAULT_TRAFFIC, density_named, hour_density, level_density

    base = level_density(los).name if los is not None else hour_density(hour).name if hour is not None else density
    return density_named(base or DEFAULT_TRAFFIC, mix or "").name


@dataclass(frozen=True)
class TrafficLevel:
    """Traffic."""

    los: Annotated[
        str | None,
        typer.Option(
            metavar="A…F",
            help=(
                "Traffic by level of service: A free, C stable, E near capacity, F stop and go; as in --los E. A "
                "level that the world cannot reach, such as A among traffic lights, is refused, and the error lists "
                "the reachable ones."
            ),
        ),
    ] = None
    hour: Annotated[
        int | None,
        typer.Option(metavar="0…23", help="Traffic of an hour of a weekday, as in --hour 8 for 8 to 9 o'clock."),
    ] = None
    density: Annotated[
        str | None, typer.Option(help="Traffic by density: low, medium, high, or numbers, as in v12-p40.")
    ] = None
    mix: Mix = None

    @property
    def name(self) -> str | None:
        """The name of the traffic; None if none is requested."""
        return traffic_name(self.density, self.los, self.hour, self.mix)


@dataclass(frozen=True)
class Distance:
    """A distance from the inspected segments; None for the whole town."""

    m: float | None


def _traffic_area(text: str) -> Distance:
    from pavetwin.config.mission import LEAST_AREA_M

    if text == "all":
        return Distance(None)
    try:
        distance_m = float(text)
    except ValueError:
        raise typer.BadParameter(f"expected metres or 'all', not '{text}'.") from None
    if not LEAST_AREA_M <= distance_m < float("inf"):
        raise typer.BadParameter(
            f"traffic needs {LEAST_AREA_M:g} m of streets to queue and to spread out; give {LEAST_AREA_M:g} or more, "
            f"or 'all', not {text}."
        )
    return Distance(distance_m)


@dataclass(frozen=True)
class TrafficOptions(TrafficLevel):
    """Traffic."""

    recording: Annotated[
        Path | None,
        typer.Option("--traffic", metavar="FILE.parquet", help="A recording of this world. Replaces --los."),
    ] = None
    routes: Annotated[
        list[Path] | None, typer.Option(metavar="FILE.rou.xml", help="Your own SUMO demand. Replaces --los.")
    ] = None
    take_off_s: Annotated[
        float | None,
        typer.Option(
            "--take-off",
            metavar="SECONDS",
            help=(
                "Take-off after the traffic begins. Unless given, 0 for a density, which is warmed up; with "
                "--routes, 300 s after the first departure, or at the last one if that is earlier."
            ),
        ),
    ] = None
    traffic_area: Annotated[
        Distance | None,
        typer.Option(
            metavar="METRES|all",
            parser=_traffic_area,
            help="Simulate only the streets within this distance of the segments, 100 or more, with the traffic that "
            "the town has there. all, the default: the whole town.",
        ),
    ] = None

    @property
    def asked(self) -> str | None:
        """The name of the traffic; None where a mix alone is given, which leaves the level to the world."""
        return self.name if (self.density, self.los, self.hour) != (None, None, None) else None

    def check(self, context: typer.Context) -> None:
        """Raises:
        PaveTwinError: options were given of which each replaces the others.
        """
        for level in ("los", "hour", "density", "mix", "traffic_area"):
            refuse_together(context, level, "recording", "routes")

    def planning(self) -> dict[str, Any]:
        """The traffic as `plan_missions` takes it."""
        return {
            "density": self.asked,
            "mix": self.mix or "",
            "routes": self.routes or (),
            "recording": self.recording,
            "take_off_s": self.take_off_s,
        }

    def settings(self) -> dict[str, Any]:
        """The settings that were given."""
        return {} if self.traffic_area is None else {"traffic_area_m": self.traffic_area.m}


def _segment_count(text: str) -> int | None:
    if text == "all":
        return None
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"expected a number or 'all', not '{text}'.") from None


USUAL_COUNT: Final = 8
USUAL_ORDER: Final = "random"


@dataclass(frozen=True)
class TargetOptions:
    """Segments to inspect."""

    count: Annotated[
        int | None,
        typer.Option("--segments", metavar="N|all", parser=_segment_count, help="Number of segments to inspect."),
    ] = USUAL_COUNT
    names: Annotated[
        list[str] | None,
        typer.Option(
            "--segment",
            metavar="ID|STREET",
            help='Inspect this segment, or all of this street, as in --segment "Bell Lane"; may be repeated. Replaces '
            "--segments.",
        ),
    ] = None
    order: Annotated[str, typer.Option(help="Order of the segments: random, or near for a short tour.")] = USUAL_ORDER
    base: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON|x,y",
            help="Take-off place, in degrees or in metres of the world's frame. Unless given, next to the carriageway "
            "in the middle of the streets; with --preset paper, on it.",
        ),
    ] = None

    def planning(self) -> dict[str, Any]:
        """The segments and the base as `plan_missions` takes them."""
        return {"segments": self.names or self.count, "order": self.order, "base": self.base}

    @property
    def is_usual(self) -> bool:
        """Whether the segments follow from the seed alone."""
        return not self.names and self.order == USUAL_ORDER and self.count == USUAL_COUNT


@dataclass(frozen=True)
class AircraftOptions:
    """Aircraft."""

    altitude_m: Annotated[float | None, typer.Option("--altitude", help="Metres above ground; default: 10.")] = None
    aircraft: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.yaml",
            help="{aircraft}, or your own, as in --aircraft mine.yaml:survey. Default: mavic3e.",
        ),
    ] = None
    airspace: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Other aircraft: aircraft, t_s, x_m, y_m, altitude_m.")
    ] = None

    def settings(self) -> dict[str, Any]:
        """The settings that were given.

        Raises:
            PaveTwinError: the altitude does not fit.
        """
        from pavetwin.config.mission import check_altitude

        if self.altitude_m is not None:
            check_altitude(self.altitude_m)
        given = {"altitude_m": self.altitude_m, "aircraft": self.aircraft}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True)
class Wind:
    """Wind over the streets."""

    wind_mps: float
    wind_from_deg: float | None = None
    """Direction that it comes from, clockwise from north; None for that of the settings."""


@dataclass(frozen=True)
class ParkedVehicles:
    """Parked vehicles of a mission, as in `ParkingSettings`."""

    enabled: bool
    occupancy: float | None = None

    def settings(self) -> dict[str, Any]:
        """The setting `parking`."""
        return asdict(self) if self.enabled else {"enabled": False}


def _condition(name: str, text: Any) -> Any:
    """The value of one condition, checked."""
    return _checked_conditions({name: text})[name]


def _wind(text: str) -> Wind:
    parts = re.fullmatch(r"(?P<speed>\d+(\.\d*)?)(@(?P<from>\d+(\.\d*)?))?", text)
    if parts is None:
        raise typer.BadParameter(
            f"expected metres per second, optionally with the direction it comes from, as in 5@270, not '{text}'."
        )
    values = {"wind_mps": parts["speed"], "wind_from_deg": parts["from"]}
    given = {name: float(value) for name, value in values.items() if value is not None}
    return Wind(**_checked_conditions(given))


def _checked_conditions(given: Mapping[str, Any]) -> dict[str, Any]:
    from pydantic import ValidationError

    from pavetwin.config import Conditions
    from pavetwin.config.settings import complaint

    try:
        conditions = Conditions.model_validate(given)
    except ValidationError as error:
        raise typer.BadParameter(f"{complaint(error)} (got {', '.join(map(str, given.values()))}).") from error
    return {name: getattr(conditions, name) for name in given}


def _parking(text: str) -> ParkedVehicles:
    if text == "none":
        return ParkedVehicles(enabled=False)
    if text == "by-time":
        return ParkedVehicles(enabled=True)
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if not 0 <= share <= 1:
        raise typer.BadParameter(f"expected a share of the places (0 to 1), by-time, or none, not '{text}'.")
    return ParkedVehicles(enabled=True, occupancy=share)


Parking = Annotated[
    ParkedVehicles | None,
    typer.Option(
        metavar="SHARE|by-time|none",
        parser=_parking,
        help="Occupied share of the parking places, 0…1; by-time: by the daily curve of the date and time; or none. "
        "Default: by-time; none with --preset paper and in exports.",
    ),
]


@dataclass(frozen=True)
class DaylightOptions:
    """Date, time and clouds."""

    date: Annotated[
        dt.date | None,
        typer.Option(
            metavar="YYYY-MM-DD",
            parser=partial(_condition, "date"),
            help="Date of the flight, for parked vehicles and the light of images.",
        ),
    ] = None
    time: Annotated[
        dt.time | None,
        typer.Option(
            metavar="HH:MM",
            parser=partial(_condition, "time"),
            help="Time of day at take-off: mean solar time at the world's base.",
        ),
    ] = None
    clouds: Annotated[
        float | None,
        typer.Option(metavar="0…1", parser=partial(_condition, "clouds"), help="Cloud cover: 0 clear, 1 overcast."),
    ] = None

    def conditions(self) -> dict[str, Any]:
        """The conditions that were given."""
        given = {"date": self.date, "time": self.time, "clouds": self.clouds}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True)
class ConditionOptions(DaylightOptions):
    """Date, weather and parked vehicles."""

    wind: Annotated[
        Wind | None,
        typer.Option(
            metavar="SPEED[@FROM]",
            parser=_wind,
            help="Wind in m/s, and the direction it comes from in degrees, as in 5@270.",
        ),
    ] = None
    parking: Parking = None

    def settings(self) -> dict[str, Any]:
        """The settings that were given."""
        wind = {} if self.wind is None else {key: each for key, each in asdict(self.wind).items() if each is not None}
        conditions = {**self.conditions(), **wind}
        parking = {} if self.parking is None else {"parking": self.parking.settings()}
        return {**({"conditions": conditions} if conditions else {}), **parking}


@dataclass(frozen=True)
class SensorOptions:
    """Sensor."""

    sensor: Annotated[str | None, typer.Option(help="{sensors}, or your own, file.py:ClassName. Default: recall.")] = (
        None
    )
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="For --sensor detector, one that ships or a file of `pavetwin export`; for --sensor calibrated, one "
            f"that ships or a file of `pavetwin sensor fit`. Default: {DEFAULT}.",
        ),
    ] = None

    def settings(self, choose: Callable[..., "MissionSettings"]) -> dict[str, Any]:
        """The settings that were given.

        Args:
            choose: makes the settings of the mission, from those of this group that do not depend on the model.

        Raises:
            PaveTwinError: there is no such model.
        """
        given: dict[str, Any] = {} if self.sensor is None else {"sensor": self.sensor}
        if self.model is not None:
            chosen = choose(**({"sensing": given} if given else {})).sensing.sensor
            given = {**given, "options": _sensor_model(self.model, chosen)}
        return {"sensing": given} if given else {}

    def check(self, settings: "MissionSettings") -> None:
        """Raises:
        PaveTwinError: a model is given to a sensor that takes none.
        """
        from pavetwin.sensing.sensor import sensor_class

        sensor = settings.sensing.sensor
        if self.model is not None and "model" not in sensor_class(sensor).default_options:
            raise PaveTwinError(f"`model`: the sensor '{sensor}' takes none; add --sensor detector.")


def _sensor_model(model: str, sensor: str) -> dict[str, str]:
    """The option of a sensor that --model sets: the fitted sensor of `calibrated`, unless it names an ONNX file.

    One that ships keeps its name, which holds on any machine.

    Raises:
        PaveTwinError: there is no such file, and none that ships has this name.
    """
    from pavetwin.perception.model_file import FOLDER
    from pavetwin.sensing.fitted_sensor import sensor_path
    from pavetwin.sensing.sensor import sensor_class

    if model.endswith(".json") and not Path(model).is_file():
        raise PaveTwinError(
            f"`model`: there is no file '{model}'; `pavetwin sensor fit MISSIONS --output {model}` writes one."
        )
    if model.endswith(".json") or ("fitted" in sensor_class(sensor).default_options and not model.endswith(".onnx")):
        with about("model"):
            sensor_path(model)
        return {"fitted": model}
    file = detector_file(model)
    return {"model": file.stem if file.parent == FOLDER else str(file)}


@dataclass(frozen=True)
class SettingsOptions:
    """Settings."""

    seed: Annotated[int, typer.Option(help="Random seed of traffic, order and sensor; 0 is valid.")] = 0
    preset: Annotated[str, typer.Option(help="default or paper.")] = "default"
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated."),
    ] = None
    plugins: Plugins = None

    def load(self, *given: Mapping[str, Any], sensor: SensorOptions) -> "MissionSettings":
        """The settings of a mission.

        Args:
            given: settings by other groups.

        Raises:
            PaveTwinError: a value does not fit.
        """
        from pavetwin.config import load_settings

        paths = paths_of(self.plugins)
        values = {key: value for each in given for key, value in each.items()}
        if paths:
            values["plugins"] = paths
        choose = partial(load_settings, self.preset, self.overrides or (), **values)
        settings = choose(**sensor.settings(choose))
        sensor.check(settings)
        return settings


@dataclass(frozen=True)
class DetectorOptions:
    """Detector."""

    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="NAME|FILE.onnx",
            help=f"A file of `pavetwin export`, or a detector that ships: {DEFAULT} (default), or photographs.",
        ),
    ] = None
    confidence: Annotated[float, typer.Option(help="Lowest confidence of reported detections, from 0 to 1.")] = 0.25
    tiled: Annotated[
        bool | None,
        typer.Option(
            "--tiled/--whole",
            help=(
                "Search large images in tiles at their own resolution, or scaled down as a whole; default: as the "
                "model was trained."
            ),
        ),
    ] = None
    overview: Annotated[
        bool,
        typer.Option(
            "--overview",
            help="Search large images both in tiles and as a whole: finds more, and takes up to five times as long for "
            "small images, 5 % longer for large ones.",
        ),
    ] = False

    @property
    def file(self) -> Path:
        """The file of the model.

        Raises:
            PaveTwinError: there is none.
        """
        return detector_file(self.model)


def detector_file(model: str | None) -> Path:
    """The file of a model: that of the default detector where none is named.

    Raises:
        PaveTwinError: there is none.
    """
    from pavetwin.perception.model_file import model_path

    try:
        return model_path(model or DEFAULT)
    except PaveTwinError as error:
        raise PaveTwinError(f"`model`: {error}") from error


def naming_options(**parameters: Any) -> Any:
    """Errors in the block name options in place of settings, where the option was given.

    Args:
        parameters: what the user gave, by parameter.
    """
    settings = {"sensor": "sensing.sensor:", "wind": "conditions.wind_mps:"}
    return naming({settings[name]: f"`{name}`:" for name, value in parameters.items() if value is not None})

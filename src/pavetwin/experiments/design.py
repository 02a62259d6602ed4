"""The design of a study: what it varies, holds fixed and repeats, as typed YAML without unknown keys."""

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Annotated, Any, Final, Literal, Self

import yaml
from pydantic import (
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    field_validator,
    model_serializer,
    model_validator,
)

from pavetwin.config import Conditions, MissionSettings, Settings
from pavetwin.config.mission import Altitude
from pavetwin.config.settings import ALIASES
from pavetwin.config.text import parse_yaml, why_unread
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError, nearest_name, no_such
from pavetwin.experiments.metrics import EVERY_METRIC, FACTORS, METRICS, REFERENCE
from pavetwin.uav.entries import own_file

_PRESETS: Final = {
    "paper": {
        "name": "paper",
        "settings": "paper",
        "summary": "The paper's full study (arXiv 2606.20742): 3 densities × 3 altitudes × 4 policies × 20 replicates, "
        "720 segment missions.",
        "densities": "[low, medium, high]",
        "or_nearest": "false",
        "altitudes_m": "[6, 10, 15]",
        "replicates": "20",
        "defects": "{population: paper}",
    },
    "default": {
        "name": "study",
        "settings": "default",
        "summary": "A first look: two altitudes, traffic at levels of service B, C and E, all four policies; some "
        "minutes on a laptop.",
        "densities": "[los-B, los-C, los-E]",
        "or_nearest": "true",
        "altitudes_m": "[6, 10]",
        "replicates": "8",
        "defects": "placed",
    },
}
"""Values of the shipped designs in `design_template.yaml`. Each uses the preset of settings of its name."""

IN_DESIGN: Final = dict(
    zip(FACTORS, ("worlds", "densities", "altitudes_m", "policies", "sensors", "presets"), strict=True)
)
"""Factor → the key of a design that lists its levels."""

FACTOR_OF: Final[Mapping[str, str]] = {"altitude_m": "altitudes_m", "sensing.sensor": "sensors"}
"""Settings that are factors by themselves."""

ENVIRONMENT: Final = tuple(f"conditions.{name}" for name in Conditions.model_fields)
"""Settings of the environment: assumptions of a study, not options to choose from."""

OWN_ROUTES: Final = "routes"
"""The level of the factor traffic in a world with the user's own routes."""

FROM_FILES: Final = ("aircraft", "camera.model")
"""Settings that may name a file, besides the factors that do."""

Value = bool | int | float | str

ALL: Final = "all"
"""Value of `segments` for every reachable segment."""

SegmentCount = Annotated[
    Annotated[Literal["all"], Tag("all")] | Annotated[int, Field(ge=1, le=1000), Tag("number")],
    Discriminator(lambda value: "all" if value == ALL else "number"),
]
"""Number of segments of a mission. Discriminated first, so that an error mentions one kind only."""

_LISTS: Final = ("worlds", "densities", "altitudes_m", "policies", "sensors", "presets", "plugins", "streets")


Placing = Annotated[
    Annotated[Literal["placed", "world"], Tag("how")] | Annotated[DefectOptions, Tag("options")],
    Discriminator(lambda value: "how" if isinstance(value, str) else "options"),
]
"""Placement of defects. Discriminated first, so that an error names its own key."""


class WorldEntry(Settings):
    path: str
    """Its folder; relative to the design's file."""
    routes: tuple[str, ...] = ()
    """SUMO route files that replace the densities."""
    recordings: tuple[str, ...] = ()
    """Files of recorded traffic that replace the densities: each is a level of traffic, named as its file."""
    take_off_s: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]] | None = Field(
        default_factory=lambda given: None if given.get("routes") or given.get("recordings") else (0.0, 0.0)
    )
    """Earliest and latest take-off with routes or recordings, in seconds after the first departure, or within the
    recording; drawn in each replicate. Unless given, after a warm-up, as `fly` does."""
    nearest: dict[str, str] = Field(default_factory=dict)
    """Levels of service of the design that the world cannot reach → the nearest that it can, flown in their place; a
    study with `or_nearest` finds them."""

    @property
    def traffics(self) -> tuple[str, ...]:
        """The levels of traffic that are its own; empty where it has the design's densities."""
        return (OWN_ROUTES,) if self.routes else tuple(Path(file).stem for file in self.recordings)

    def recording(self, traffic: str) -> Path | None:
        """The file of a level of traffic; None where it is not recorded yet."""
        return next((Path(file) for file in self.recordings if Path(file).stem == traffic), None)

    def files(self, traffic: str) -> tuple[str, ...]:
        """The files that a level of traffic is made from."""
        recording = self.recording(traffic)
        return self.routes if recording is None else (str(recording),)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.take_off_s and self.take_off_s[0] > self.take_off_s[1]:
            raise ValueError("take_off_s: the earliest comes first")
        if self.take_off_s and self.take_off_s[1] > 0 and not self.traffics:
            raise ValueError("take_off_s: only with routes or recordings; the densities hold over time")
        if self.routes and self.recordings:
            raise ValueError("recordings: a world has routes or recordings, not both")
        if twice := [name for name in self.traffics if self.traffics.count(name) > 1]:
            raise ValueError(f"recordings: two of them are called '{twice[0]}'; rename one")
        return self


class Design(Settings):
    """A factorial design: every combination of its factors is flown in every replicate."""

    name: Annotated[str, Field(min_length=1)] = "study"
    worlds: Annotated[tuple[WorldEntry, ...], Field(min_length=1)]
    densities: tuple[str, ...] = ("low", "medium", "high")
    """Names of traffic as `density_named` reads them: low, `los-C` (level of service), `hour-08` (of a weekday),
    numbers as `v12-p40` (vehicles per kilometre of lane, pedestrians per kilometre of sidewalk), each with a mix of
    vehicles behind a plus sign (`los-C+south_asia`)."""
    or_nearest: bool = False
    """In a world that cannot reach a level of service, fly in the nearest that it can, with a notice; unless set,
    these missions fail."""
    altitudes_m: Annotated[tuple[Altitude, ...], Field(min_length=1)] = (6.0, 10.0, 15.0)
    policies: Annotated[tuple[str, ...], Field(min_length=1)] = ("baseline", "hover", "micro", "skip")
    sensors: Annotated[tuple[str, ...], Field(min_length=1)] = ("recall",)
    presets: Annotated[tuple[str, ...], Field(min_length=1)] = ("default",)
    sweep: dict[str, Annotated[tuple[Value, ...], Field(min_length=1)]] = Field(default_factory=dict)
    """Setting → values; every value is combined with all else."""
    set: dict[str, Value] = Field(default_factory=dict)
    """Settings that are the same in all missions; they override the presets."""
    plugins: tuple[str, ...] = ()
    """Python files that register what the design names or its worlds hold; relative to the design's file."""
    replicates: Annotated[int, Field(ge=1, le=100_000)] = 20
    streets: tuple[str, ...] = ()
    """Names of streets or ids of segments that missions inspect; all that can be reached where there are none."""
    segments: SegmentCount = 1
    """Number of segments of a mission, drawn in each replicate; `all` for every reachable one."""
    order: Literal["random", "near"] = "random"
    """Order of the segments of a mission: drawn in each replicate, or a short tour from the base."""
    seed: Annotated[int, Field(ge=0)] = 1
    compare: str = REFERENCE
    """The policy that the others are compared with, by the name that the table has; `all` for every pair."""
    defects: Placing = "placed"
    """`placed` in each replicate as densely as the world was built, or by these options; `world` keeps its own."""

    @field_validator(*_LISTS, mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        if isinstance(value, Value):
            raise ValueError(f"give a list, like [{value}]")
        return value

    @field_validator("densities", "streets", mode="before")
    @classmethod
    def _texts(cls, value: Any) -> Any:
        """Numbers as texts: the reader of densities refuses them with a message, and streets may have them."""
        return [str(each) for each in value] if isinstance(value, list | tuple) else value

    @field_validator("sweep", mode="before")
    @classmethod
    def _listed_each(cls, value: Any) -> Any:
        for key, values in value.items() if isinstance(value, Mapping) else ():
            if isinstance(values, Value):
                raise ValueError(f"{key}: give a list, like [{values}]")
        return value

    @field_validator("worlds", mode="before")
    @classmethod
    def _entries(cls, value: Any) -> Any:
        if not isinstance(value, Sequence) or isinstance(value, str):
            return value
        return [{"path": entry} if isinstance(entry, str) else entry for entry in value]

    @field_validator(*_LISTS[1:])
    @classmethod
    def _distinct(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if twice := [value for value in values if values.count(value) > 1]:
            raise ValueError(f"{twice[0]} is given twice")
        return values

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not self.densities and any(not world.traffics for world in self.worlds):
            raise ValueError("densities: give at least one; only a world with its own traffic needs none")
        if "densities" in self.model_fields_set and self.densities and all(world.traffics for world in self.worlds):
            raise ValueError("densities: every world has its own traffic, which takes their place; give []")
        paths = [world.path for world in self.worlds]
        if len(set(paths)) < len(paths):
            raise ValueError("worlds: one of them is given twice")
        measured = [metric.name for metric in EVERY_METRIC]
        taken = {*FACTORS, *measured, "replicate", "seed", "segment", "status"}
        settings = [ALIASES.get(key, key) for key in (*self.sweep, *self.set)]
        for key, values in self.sweep.items():
            if key in taken - set(ALIASES):
                raise ValueError(f"sweep: '{key}' is not a setting to sweep{_instead(key)}")
            if "." not in key and key not in {*ALIASES, *MissionSettings.model_fields}:
                near = (
                    nearest_name(key, ALIASES)
                    or f"; short names are {', '.join(ALIASES)}, others go by their full name"
                )
                raise ValueError(f"sweep: unknown setting '{key}'{near}")
            if len(set(values)) < len(values):
                raise ValueError(f"sweep: a value of {key} is given twice")
        if factors := [setting for setting in settings if setting in FACTOR_OF]:
            raise ValueError(f"{factors[0]} is a factor; list its values under '{FACTOR_OF[factors[0]]}'")
        if twice := [setting for setting in settings if settings.count(setting) > 1]:
            raise ValueError(f"{twice[0]} is given twice, under sweep or set")
        return self

    @model_serializer(mode="wrap")
    def _as_flown(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without densities that no world uses: a design that lists them is refused."""
        values: dict[str, Any] = dump(self)
        if "densities" in values and all(world.traffics for world in self.worlds):
            values["densities"] = []
        return values

    @property
    def tours(self) -> bool:
        """True if a mission is a tour, judged as a whole from take-off to landing instead of by segment."""
        return self.segments == ALL or self.order == "near"

    @property
    def sweep_columns(self) -> tuple[str, ...]:
        """Names of the table's columns of swept parameters: those that are a metric's too end in `_set`."""
        metrics = {metric.name for metric in METRICS}
        return tuple(f"{key}_set" if key in metrics else key for key in self.sweep)

    def traffics(self, world: int) -> tuple[str, ...]:
        """The levels of traffic over a world, by its place."""
        entry = self.worlds[world]
        return entry.traffics or tuple(dict.fromkeys(entry.nearest.get(name, name) for name in self.densities))


def read_design(path: Path) -> Design:
    """A design from its file, its paths made absolute.

    Raises:
        PaveTwinError: there is none, it is not valid YAML, a key is given twice, or a key or value does not fit.
    """
    try:
        values = parse_yaml(path.read_text(encoding="utf-8"), where=f"the design '{path}'")
    except OSError as error:
        raise PaveTwinError(
            f"Cannot read the design '{path}': {error.strerror}. `pavetwin experiment init` writes one."
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        raise PaveTwinError(f"The design '{path}' is not valid YAML: {why_unread(error)}.") from error
    if isinstance(values, Mapping) and {"format", "design"} <= values.keys():
        values = values["design"]  # from a study's folder
    if not isinstance(values, Mapping):
        raise PaveTwinError(f"The design '{path}' holds no keys; `pavetwin experiment init` writes one.")
    return placed_at(Design.parse(values, where=f"the design '{path}'"), path.absolute().parent)


def placed_at(design: Design, folder: Path) -> Design:
    """The design with paths that were relative to `folder` made absolute."""

    def whole(path: str) -> str:
        return str((folder / path).resolve())

    worlds = tuple(
        world.model_copy(
            update={
                "path": whole(world.path),
                "routes": tuple(map(whole, world.routes)),
                "recordings": tuple(map(whole, world.recordings)),
            }
        )
        for world in design.worlds
    )
    policies = tuple(whole(name) if ":" in name else name for name in design.policies)
    sensors = tuple(whole(name) if ":" in name else name for name in design.sensors)
    plugins = tuple(whole(path) for path in design.plugins)

    def placed(key: str, value: Value) -> Value:
        if ALIASES.get(key, key) not in FROM_FILES or not isinstance(value, str) or own_file(value) is None:
            return value
        return whole(value)

    held = {key: placed(key, value) for key, value in design.set.items()}
    sweep = {key: tuple(placed(key, value) for value in values) for key, values in design.sweep.items()}
    changes = {"worlds": worlds, "policies": policies, "sensors": sensors, "plugins": plugins}
    return design.model_copy(update={**changes, "set": held, "sweep": sweep})


def preset_names() -> list[str]:
    """The designs that ship with the package."""
    return sorted(_PRESETS)


def preset_text(name: str, world: str, plugins: Sequence[str] = (), policies: Sequence[str] = ()) -> str:
    """The commented text of a design that ships with the package, over a world, with a user's plugin files and
    policies.

    Raises:
        PaveTwinError: there is no such design.
    """
    if name not in _PRESETS:
        raise PaveTwinError(no_such("design", name, preset_names(), key="`preset`"))
    template = (files("pavetwin.experiments") / "design_template.yaml").read_text(encoding="utf-8")
    entry = yaml.safe_dump(world, width=1000, allow_unicode=True).removesuffix("\n...\n").strip()
    return Template(template).substitute(
        _PRESETS[name],
        world=entry,
        plugins=json.dumps([*plugins], ensure_ascii=False),
        policies=", ".join((*Design.model_fields["policies"].default, *policies)),
    )


def _instead(key: str) -> str:
    return f"; list its values under '{IN_DESIGN[key]}'" if key in IN_DESIGN else ""

"""The recommendation of a study for each street, and its flight.

A street has far fewer missions than the study, so the best mean there is often the best by chance. The study's own
recommendation therefore holds for a street unless the missions over that street separate another option from it: p, in
pairs, below 0.05 divided by the number of compared streets (Bonferroni)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from pavetwin.config import MissionSettings
from pavetwin.config.options import OptionValue
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import Advice, advise
from pavetwin.experiments.design import OWN_ROUTES, Design, WorldEntry
from pavetwin.experiments.metrics import REPLICATE
from pavetwin.experiments.statistics import MissionLimits, Objective, Recommendation, recommend
from pavetwin.experiments.statistics.simultaneous import ALPHA
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import SHOWN, Cell, are_texts, cells_of, content_of
from pavetwin.experiments.words import level_text, setting
from pavetwin.flightplan.of_mission import check_place
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, defects_of, load_inputs
from pavetwin.mission.planning import defect_input, plan_mission, traffic_input
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import DefectInput, MissionSpec
from pavetwin.policies import policy_class
from pavetwin.reports.words import listed
from pavetwin.sensing import ImageSource
from pavetwin.world.model import World
from pavetwin.world.store import load_world

CHOSEN: Final = ("world", "traffic", "sensor", "preset")
"""Columns of which a handover has one level each: where, when, and how missions are judged."""


@dataclass(frozen=True)
class StreetAdvice:
    """The recommendation of a study in one world, traffic, sensor and preset, and that of each street."""

    study: str
    levels: Mapping[str, str]
    """Levels of the columns `CHOSEN`."""
    overall: Advice
    table: pl.DataFrame
    """A row a street: `street`, `fly` (what to fly, in words), `replicates` (with a coverage), `expected_coverage` (the
    mean there of what to fly; null without one) and `from` (why: `the study` or `this street`)."""
    segments: tuple[str, ...]
    """Ids of the segments that the study flew over, in the order of their first mission."""
    content: str = ""
    """Shortened hash of the world in the study (`pavetwin.experiments.units.content_of`); empty if unknown."""
    of_defects: bool = False
    """True if the study flew over the world's own defects; `content` then covers them."""

    @property
    def world(self) -> str:
        return self.levels["world"]

    @property
    def option(self) -> Mapping[str, Any]:
        """The levels to fly: altitude, policy and what else the study varied."""
        best = self.overall.recommendation.best
        assert best is not None
        return {name: best[name] for name in self.overall.recommendation.by}


def street_advice(
    study: str,
    table: pl.DataFrame,
    design: Mapping[str, Any],
    levels: Mapping[str, str | None],
    limits: MissionLimits,
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
) -> StreetAdvice:
    """The recommendation of a study, over all and for each street.

    Args:
        study: its name.
        table: with one row per segment mission.
        design: plain values of `design.yaml`.
        levels: of `CHOSEN`; None where the study has one alone.
        limits, objective: as `advise` takes them. Of a street only the least coverage is judged: limits of time and
            energy are of whole missions.

    Raises:
        PaveTwinError: a level is ambiguous or unknown, or no option keeps the limits.
    """
    chosen = {name: _level(table, name, levels.get(name)) for name in CHOSEN}
    table = table.filter(pl.col(name) == level for name, level in chosen.items())
    (overall,) = advise(table, limits, objective=objective, seed=seed, design=design)
    if overall.recommendation.best is None:
        raise PaveTwinError(f"The study '{study}' recommends nothing to hand over: {overall.sentences[0]}")
    streets = table["street"].unique(maintain_order=True).to_list()
    own = MissionLimits(min_coverage=limits.min_coverage)
    rows = [
        _row(street, table.filter(street=street), overall.recommendation, own, objective, seed, len(streets))
        for street in streets
    ]
    schema = {
        **{"street": pl.String, "fly": pl.String, "from": pl.String},
        **{"replicates": pl.Int64, "expected_coverage": pl.Float64},
    }
    segments = tuple(table["segment"].unique(maintain_order=True).to_list())
    return StreetAdvice(study, chosen, overall, pl.DataFrame(rows, schema=schema), segments)


def _level(table: pl.DataFrame, name: str, asked: str | None) -> str:
    """Raises:
    PaveTwinError: the study has several levels and none is selected, or the selected one is missing.
    """
    levels = table[name].unique(maintain_order=True).to_list()
    if asked is None and len(levels) > 1:
        raise PaveTwinError(f"`{name}`: the study has {listed(levels)}, and a handover is for one; name it.")
    if asked is not None and asked not in levels:
        raise PaveTwinError(f"`{name}` {asked}: the study has {listed(levels)}.")
    return str(asked or levels[0])


def _row(
    street: str,
    table: pl.DataFrame,
    overall: Recommendation,
    limits: MissionLimits,
    objective: Objective,
    seed: int,
    streets: int,
) -> dict[str, Any]:
    by, replicates = list(overall.by), table.filter(pl.col("coverage").is_not_null())[REPLICATE].n_unique()
    assert overall.best is not None
    usual = {name: overall.best[name] for name in by}
    option, source = usual, "the study"
    if replicates >= FEW:
        here = recommend(table, limits, by, objective=objective, seed=seed)
        if here.best is not None and _is_separate(here, usual, ALPHA / streets):
            option, source = {name: here.best[name] for name in by}, "this street"
    of_option = table.filter(pl.col(name).eq_missing(level) for name, level in option.items())
    return {
        "street": street,
        "fly": option_words(option, by),
        "from": source,
        "replicates": replicates,
        "expected_coverage": of_option["coverage"].mean(),
    }


def _is_separate(here: Recommendation, usual: Mapping[str, Any], least: float) -> bool:
    """True if missions over a street show that its best option is better than the study's."""
    rows = here.options.filter(pl.col(name).eq_missing(level) for name, level in usual.items()).to_dicts()
    return any(row["p"] is not None and row["p"] < least and not row["same"] for row in rows)


def option_words(option: Mapping[str, Any], by: Sequence[str]) -> str:
    """`hover at 10 m`."""
    rest = [name for name in by if name not in ("policy", "altitude_m")]
    words = f"{option['policy']} at {level_text('altitude_m', option['altitude_m'])}"
    return f"{words} {setting(option, rest)}" if rest else words


Tell = Callable[[float, str], None]
"""Told the share done and what is being done."""

ImagesOf = Callable[[MissionInputs, MissionSpec], ImageSource]
"""Makes what takes the images of a mission."""


def advice_of(
    folder: Path,
    levels: Mapping[str, str | None],
    limits: MissionLimits,
    objective: Objective = Objective.MOST_FOUND,
) -> StreetAdvice:
    """The recommendation of the study in a folder; see `street_advice`.

    Raises:
        PaveTwinError: there is no study, or as `street_advice`.
    """
    store = Store(folder)
    design = store.design()
    plain = design.model_dump(mode="json")
    name = folder.resolve().name
    advice = street_advice(name, store.table(), plain, levels, limits, objective=objective, seed=design.seed)
    content = store.description()["worlds"].get(advice.world, "")
    return replace(advice, content=content, of_defects=design.defects == "world")


def fly_recommended(folder: Path, advice: StreetAdvice, images: ImagesOf, tell: Tell) -> MissionResult:
    """Fly what a study recommends: over the segments that it flew over, with its defects and traffic, under its seed.

    Args:
        folder: of the study.
        images: for a sensor that looks at them.

    Raises:
        PaveTwinError: the world is missing, differs from that of the study, or is not georeferenced; or the mission
        cannot be flown.
    """
    store = Store(folder)
    design = store.design()
    entry, world = _world(design, advice.world, store.description()["worlds"])
    check_place(world)
    cell = _cell(store, design, advice)
    settings = _with_models(cell.settings(design), store.models().get(cell.sensor, {}))
    tell(0.0, "Preparing the flight domain")
    spec, inputs = _planned(design, entry, world, cell, settings, advice, tell)
    inputs.on_extend(lambda share: tell(share, "Recording more traffic"))
    with inputs.replay:
        return fly(
            spec,
            inputs=inputs,
            image_source=images(inputs, spec),
            on_progress=lambda share: tell(share, f"Flying {policy_class(cell.policy).name}"),
            on_look=lambda share: tell(share, "Rendering the captures and searching them"),
        )


def _planned(
    design: Design,
    entry: WorldEntry,
    world: World,
    cell: Cell,
    settings: MissionSettings,
    advice: StreetAdvice,
    tell: Tell,
) -> tuple[MissionSpec, MissionInputs]:
    traffic = advice.levels["traffic"]
    given: dict[str, Any] = {
        "density": None if traffic == OWN_ROUTES else traffic,
        "routes": entry.routes,
        "recording": entry.recording(traffic),
    }
    source = _defects(design, world)
    mix = traffic_input(world, seed=design.seed, **given).mix
    environment = prepare(world, settings, defects_of(world, source), parking_seed=design.seed, parking_mix=mix)
    planned = plan_mission(
        world,
        settings,
        **given,
        segments=advice.segments,
        order="near",
        policy=cell.policy,
        seed=design.seed,
        environment=environment,
    )
    defects = source.model_copy(update={"content_hash": environment.defects_hash})
    spec = planned.model_copy(update={"defects": defects})
    inputs = load_inputs(spec, world=world, environment=environment, on_progress=tell)
    return inputs.flown(spec), inputs


def _with_models(settings: MissionSettings, models: Mapping[str, OptionValue]) -> MissionSettings:
    """Settings with the models of the study, if its design leaves them to the sensor."""
    sensing = settings.sensing.model_copy(update={"options": {**models, **settings.sensing.options}})
    return settings.model_copy(update={"sensing": sensing})


def _defects(design: Design, world: World) -> DefectInput:
    """Defects of the design."""
    if isinstance(design.defects, DefectOptions):
        return DefectInput(seed=design.seed, options=design.defects)
    return defect_input(world, None if design.defects == "world" else design.seed)


def _world(design: Design, name: str, contents: Mapping[str, str]) -> tuple[WorldEntry, World]:
    """Raises:
    PaveTwinError: the world of that name is missing, or differs from that of the study.
    """
    entry = dict(zip(contents, design.worlds, strict=True))[name]
    if not Path(entry.path).is_dir():
        raise PaveTwinError(f"The world '{name}' of the study is no longer at '{entry.path}'; put it back.")
    world = load_world(Path(entry.path))
    if content_of(world, with_defects=design.defects == "world")[:SHOWN] != contents[name]:
        raise PaveTwinError(f"The world '{name}' at '{entry.path}' is not what the study flew over.")
    return entry, world


def _cell(store: Store, design: Design, advice: StreetAdvice) -> Cell:
    """The cell of the design that is recommended.

    Raises:
        PaveTwinError: the design has none.
    """
    wanted = {**advice.option, "sensor": advice.levels["sensor"], "preset": advice.levels["preset"]}
    for cell in cells_of(design, store.owners()):
        swept = zip(design.sweep_columns, design.sweep.values(), cell.swept, strict=True)
        levels = {
            **{"altitude_m": cell.altitude_m, "policy": policy_class(cell.policy).name},
            **{"sensor": cell.sensor, "preset": cell.preset},
            **{name: str(value) if value is not None and are_texts(all_) else value for name, all_, value in swept},
        }
        if all(levels.get(name) == level for name, level in wanted.items()):
            return cell
    raise PaveTwinError(f"The design of the study '{advice.study}' does not have what its table recommends.")

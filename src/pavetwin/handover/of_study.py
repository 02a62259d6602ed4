"""The mission that a study recommends: its best option, flown once over all of its streets, along a short tour."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pavetwin.config import MissionSettings
from pavetwin.config.options import OptionValue
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import OWN_ROUTES, Design, WorldEntry
from pavetwin.experiments.statistics import MissionLimits, Objective
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import SHOWN, Cell, are_texts, cells_of, content_of
from pavetwin.flightplan.of_mission import check_place
from pavetwin.handover.streets import StreetAdvice, street_advice
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, defects_of, load_inputs
from pavetwin.mission.planning import defect_input, plan_mission, traffic_input
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import DefectInput, MissionSpec
from pavetwin.policies import policy_class
from pavetwin.sensing import ImageSource
from pavetwin.world.model import World
from pavetwin.world.store import load_world

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
    """What the study in a folder recommends; see `street_advice`.

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
        PaveTwinError: the world is gone, is not what the study flew over, or has no place on the earth; or the mission
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
    environment = prepare(
        world, settings, defects_of(world, source), parking_seed=design.seed, parking_mix=mix
    )  # fmt: skip
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
    """With the models that the study was flown with, where its design leaves them to the sensor."""
    sensing = settings.sensing.model_copy(update={"options": {**models, **settings.sensing.options}})
    return settings.model_copy(update={"sensing": sensing})


def _defects(design: Design, world: World) -> DefectInput:
    """As the design has them."""
    if isinstance(design.defects, DefectOptions):
        return DefectInput(seed=design.seed, options=design.defects)
    return defect_input(world, None if design.defects == "world" else design.seed)


def _world(design: Design, name: str, contents: Mapping[str, str]) -> tuple[WorldEntry, World]:
    """Raises:
    PaveTwinError: the world of that name is gone, or is not what the study flew over.
    """
    entry = dict(zip(contents, design.worlds, strict=True))[name]
    if not Path(entry.path).is_dir():
        raise PaveTwinError(f"The world '{name}' of the study is not at '{entry.path}' any more; put it back.")
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

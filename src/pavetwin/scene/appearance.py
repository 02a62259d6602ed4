"""The appearance of each agent of a recording (model, size, colours), from the seed and its number only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.scene.meshes import bounds
from pavetwin.scene.palettes import BOTTOMS, BUS_PAINTS, HAIR, PAINTS, SKIN, TOPS, WORK_PAINTS, Colour, Tone, drawn
from pavetwin.scene.values import TINTS, Model
from pavetwin.seeds import Stream, child
from pavetwin.traffic.kinds import KINDS, VEHICLES
from pavetwin.traffic.recording import Agents

KEY: Final = 1
PARKED_KEY: Final = 11
"""Keys of this module's children of the scene's random stream: agents of a recording, and parked vehicles."""

PARKED: Final = "_parked"
"""Ends the name of a model for where its kind is parked: with fewer triangles, and without a rider."""

STAND: Final = "stand"
"""The part of a person who does not walk; walking ones are `walk_0` … in the order of the gait."""

_CARS: Final = ("hatchback", "compact", "saloon", "suv", "van")
_CLASSES: Final[Mapping[str, tuple[str, ...]]] = {
    "delivery": ("van", "light_truck"),
    "truck": ("light_truck", "heavy_truck"),
    "trailer": ("heavy_truck",),
    **dict.fromkeys(("bus", "coach", "tram"), ("bus",)),
    **dict.fromkeys(("motorcycle", "moped", "bicycle", "scooter"), ("motorcycle",)),
}
"""SUMO vehicle classes other than cars → models for them."""


@dataclass(frozen=True, eq=False)
class AgentAppearance:
    """Model, scale and colours of one agent."""

    model: str
    scale: Float64Array
    """(3,) of the model's length, width and height."""
    tints: Float32Array
    """(TINTS, 4)"""
    stride_m: float = 0.0
    """Distance walked in one gait cycle; 0 for vehicles."""
    first_phase: float = 0.0
    """Phase of the gait, 0 … 1, when the agent appears."""


def appearance_of(agents: Agents, agent: int, seed: int, models: Mapping[str, Model]) -> AgentAppearance:
    """The appearance of one agent. `models` must hold those of `traffic.kinds`, and people."""
    rng = child(seed, Stream.SCENE, KEY, agent)
    if agents.is_pedestrian[agent]:
        return _person(agents.kind[agent], float(agents.height_m[agent]), rng, models)
    size = np.array([agents.length_m[agent], agents.width_m[agent], agents.height_m[agent]], dtype=np.float64)
    return _vehicle(vehicle_model(agents.kind[agent], size), size, rng)


def parked_appearance(kind: str, key: int, seed: int, models: Mapping[str, Model]) -> AgentAppearance:
    """The appearance of a parked vehicle of a kind, at its real size; `key` is of `ParkedVehicles.appearance`."""
    size = np.array([KINDS[kind].length_m, KINDS[kind].width_m, KINDS[kind].height_m])
    appearance = _vehicle(model := vehicle_model(kind, size), size, child(seed, Stream.SCENE, PARKED_KEY, key))
    return replace(appearance, model=f"{model}{PARKED}" if f"{model}{PARKED}" in models else model)


def vehicle_model(kind: str, size_m: Float64Array) -> str:
    """The model for one of our kinds, or for a SUMO vehicle class: the model of that class nearest in size."""
    if kind in KINDS:
        return KINDS[kind].model or kind
    candidates = _CLASSES.get(kind, _CARS)
    sizes = {each.name: np.array([each.length_m, each.width_m, each.height_m]) for each in VEHICLES}
    return min(candidates, key=lambda name: float(np.abs(np.log(sizes[name] / size_m)).sum()))


def people(models: Mapping[str, Model], kind: str) -> Sequence[str]:
    """The models for a kind of person, by name; all people where the kind has none of its own."""
    everyone = sorted(name for name, model in models.items() if model.person)
    return [name for name in everyone if models[name].person == kind] or everyone


def tints(*colours: Colour | None) -> Float32Array:
    """(TINTS, 4) for the first slots, None for the model's own colour; no emission."""
    values = np.zeros((TINTS, 4), dtype=np.float32)
    values[:, :3] = 1.0
    for slot, colour in enumerate(colours):
        if colour is not None:
            values[slot, :3] = colour
    return values


def _vehicle(model: str, size_m: Float64Array, rng: np.random.Generator) -> AgentAppearance:
    kind = KINDS[model]
    return AgentAppearance(
        model=model,
        scale=size_m / (kind.length_m, kind.width_m, kind.height_m),
        tints=tints(drawn(_paints(model, rng), rng)),
    )


def _paints(model: str, rng: np.random.Generator) -> tuple[Tone, ...]:
    if model == "bus":
        return BUS_PAINTS
    if model in ("light_truck", "heavy_truck") or (model == "van" and rng.random() < 0.5):
        return WORK_PAINTS
    return PAINTS


def _person(kind: str, height_m: float, rng: np.random.Generator, models: Mapping[str, Model]) -> AgentAppearance:
    names = people(models, kind)
    model = models[names[int(rng.integers(len(names)))]]
    low, high = bounds(model.parts[STAND])
    scale = height_m / (high[2] - low[2])
    return AgentAppearance(
        model=model.name,
        scale=np.full(3, scale),
        tints=tints(drawn(TOPS, rng), drawn(BOTTOMS, rng), drawn(HAIR, rng), drawn(SKIN, rng)),
        stride_m=model.extras["stride_m"] * scale,
        first_phase=float(rng.random()),
    )

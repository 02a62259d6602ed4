"""What is changed, one thing at a time: the default, and every other way to fly, each a study of its own.

All studies have the same seed, so that a replicate has the same segment, defects, traffic of one name, and parked
vehicles in each of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from pavetwin.config.mission import LEAST_PX
from pavetwin.experiments.design import Design, Value

INPUTS: Final = Path(__file__).parent / "inputs"
"""In a folder of their own: with a plugin all that lies beside it is hashed into a study."""
ALTITUDES_M: Final = (6.0, 10.0, 15.0, 30.0)
CRACKS_ALTITUDES_M: Final = (*ALTITUDES_M, 60.0)
"""Of studies of cracks alone, from where fine pixels still show some."""
DEFECTS: Final[Mapping[str, Any]] = {"population": "paper", "per_segment": 15}
"""Half as many as in the published study, for the time that it takes to place them."""
USUAL: Final[Mapping[str, Value]] = {"parking.enabled": True}
"""Settings of the default and of every other study that does not change them."""


class Kind(StrEnum):
    """What a difference from the default is; it decides which of the two is taken for true."""

    LEFT_OUT = "left out"
    """The default knows it. True is the default, and who leaves it out decides without it."""
    CONDITION = "condition"
    """True is what is changed: it is so on that day, and who plans with the default does not know."""
    ASSUMPTION = "assumption"
    """As a condition: the truth may be so, and the default assumes something else."""
    CHANCE = "chance"
    """Nothing is changed but the seed."""


@dataclass(frozen=True)
class Variant:
    """One study."""

    name: str
    title: str
    """Of its row."""
    kind: Kind = Kind.LEFT_OUT
    traffic: str | None = None
    """Instead of the usual one."""
    settings: Mapping[str, Value] = field(default_factory=dict)
    defects: Mapping[str, Any] = field(default_factory=lambda: DEFECTS)
    altitudes_m: tuple[float, ...] | None = None
    """Instead of `ALTITUDES_M`."""
    plugins: tuple[str, ...] = ()
    against: str = "default"
    """The variant that it is compared with."""
    seed: int = 1


def _least_px(factor: float) -> dict[str, Value]:
    return {f"sensing.least_px.{kind}": factor * pixels for kind, pixels in LEAST_PX.items()}


NO_PARKING: Final = {"parking.enabled": False}
ONE_LOOK_ONE_DRAW: Final = {"sensing.look_correlation": 0.0}
CRACKS: Final = {**DEFECTS, "mix": {"single_crack": 1}}

DEFAULT: Final = Variant("default", "as it is now")
BEFORE: Final = Variant(
    "before",
    "all of these at once, as the twin was",
    traffic="medium",
    settings={
        "aircraft": f"{INPUTS / 'before.yaml'}:phantom4",
        "energy.usable": 1.0,
        "uav.base": "street",
        "uav.inspect_speed_mps": 5.0,
        **NO_PARKING,
        **ONE_LOOK_ONE_DRAW,
        **_least_px(0.0),
    },
)
VARIANTS: Final[Sequence[Variant]] = (
    DEFAULT,
    BEFORE,
    Variant("no-parking", "no parked vehicles", settings=NO_PARKING),
    Variant("density", "density *medium* instead of level of service C", traffic="medium"),
    Variant(
        "hover-time",
        "flight time taken for hover time, all of the battery used",
        settings={"aircraft": f"{INPUTS / 'before.yaml'}:mavic3e", "energy.usable": 1.0},
    ),
    Variant("linear", "30 min of battery, whatever it does", settings={"energy.model": "linear"}),
    Variant("independent", "looks at one defect independent", settings=ONE_LOOK_ONE_DRAW),
    Variant("any-size", "no least number of pixels", settings=_least_px(0.0)),
    Variant("base-street", "take-off from the carriageway", settings={"uav.base": "street"}),
    Variant(
        "any-interval", "a capture every 0.6 s at 5 m/s, whatever the camera can",
        settings={"camera.model": f"{INPUTS / 'cameras.yaml'}:unhurried", "uav.inspect_speed_mps": 5.0},
    ),
    Variant("los-b", "level of service B", Kind.CONDITION, traffic="los-B"),
    Variant("los-e", "level of service E", Kind.CONDITION, traffic="los-E"),
    Variant("wind", "wind of 8 m/s", Kind.CONDITION, settings={"conditions.wind_mps": 8.0}),
    Variant(
        "gusts",
        "wind of 8 m/s in gusts of 12",
        Kind.CONDITION,
        settings={"conditions.wind_mps": 8.0, "conditions.gust_factor": 1.5},
    ),
    Variant("cold", "batteries at 0 °C", Kind.CONDITION, settings={"conditions.temperature_c": 0.0}),
    Variant("all-parked", "every parking place taken", Kind.CONDITION, settings={"parking.occupancy": 1.0}),
    Variant("recall-low", "recall 0.74 instead of 0.84", Kind.ASSUMPTION, settings={"sensing.recall": 0.74}),
    Variant("recall-high", "recall 0.94", Kind.ASSUMPTION, settings={"sensing.recall": 0.94}),
    Variant("pixels-double", "twice the least pixels", Kind.ASSUMPTION, settings=_least_px(2.0)),
    Variant("pixels-half", "half the least pixels", Kind.ASSUMPTION, settings=_least_px(0.5)),
    Variant("correlated", "looks wholly dependent", Kind.ASSUMPTION, settings={"sensing.look_correlation": 1.0}),
    Variant(
        "visible-half", "half of a defect must be visible", Kind.ASSUMPTION,
        settings={"sensing.min_visible_fraction": 0.5},
    ),
    Variant("exposure", "exposure of 1/2000 s", Kind.ASSUMPTION, settings={"camera.exposure_s": 0.0005}),
    Variant("slow", "inspection at 3 m/s", Kind.ASSUMPTION, settings={"uav.inspect_speed_mps": 3.0}),
    Variant("fast", "inspection at 8 m/s", Kind.ASSUMPTION, settings={"uav.inspect_speed_mps": 8.0}),
    Variant(
        "aside", "passes 1.5 m off their line", Kind.ASSUMPTION, settings={"pattern.kind": "boustrophedon_aside"},
        plugins=(str(INPUTS / "passes_aside.py"),),
    ),
    Variant("phantom", "a Phantom 4 Pro", Kind.ASSUMPTION, settings={"aircraft": "phantom4pro"}),
    Variant("camera-paper", "the paper's camera", Kind.ASSUMPTION, settings={"camera.model": "paper"}),
    Variant("defects", "30 defects a segment instead of 15", Kind.ASSUMPTION, defects={**DEFECTS, "per_segment": 30}),
    Variant("survey", "damage as surveys find it", Kind.ASSUMPTION, defects={"population": "survey"}),
    Variant("cracks", "only cracks", Kind.ASSUMPTION, defects=CRACKS, altitudes_m=CRACKS_ALTITUDES_M),
    Variant(
        "cracks-coarse", "only cracks, the paper's camera (against *only cracks*)", Kind.ASSUMPTION,
        settings={"camera.model": "paper"},
        defects=CRACKS, altitudes_m=CRACKS_ALTITUDES_M, against="cracks",
    ),
    Variant(
        "cracks-fine", "only cracks, twice the pixels each way (against *only cracks*)", Kind.ASSUMPTION,
        settings={"camera.model": f"{INPUTS / 'cameras.yaml'}:fine"},
        defects=CRACKS, altitudes_m=CRACKS_ALTITUDES_M, against="cracks",
    ),
    Variant("seed", "another seed, nothing else", Kind.CHANCE, seed=2),
)  # fmt: skip


def design_of(variant: Variant, worlds: Sequence[Path], traffic: str, replicates: int, **changes: Any) -> Design:
    """The study of a variant over all worlds.

    Args:
        traffic: the usual one.
        changes: what else is not as usual.
    """
    values = {
        "name": variant.name,
        "worlds": [str(world.absolute()) for world in worlds],
        "densities": [variant.traffic or traffic],
        "altitudes_m": list(variant.altitudes_m or ALTITUDES_M),
        "set": {**USUAL, **variant.settings},
        "replicates": replicates,
        "seed": variant.seed,
        "plugins": list(variant.plugins),
        "defects": dict(variant.defects),
        **changes,
    }
    return Design.parse(values, where=f"the study '{variant.name}'")

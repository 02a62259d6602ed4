"""The last steps of a vehicle: exact size, and the insides of wheel arches."""

from dataclasses import replace
from typing import Final

import numpy as np

from assets.models.common import Model, Part, part
from pavetwin.traffic.kinds import KINDS

MIRRORS_ABOVE: Final = 0.40
"""Share of a vehicle's height above which mirrors may stand out sideways: its width is measured below."""


def fit(model: Model, mirrors_above: float = MIRRORS_ABOVE, whole: Model | None = None) -> Model:
    """The model scaled to its kind's length, width without mirrors, and height: by a few per cent at most. Of a model
    that lacks something of its kind, `whole` is the one that has it; both are scaled alike.

    Raises ValueError if it would take more, for then the model is drawn wrongly.
    """
    measured = whole or model
    kind = KINDS[measured.name]
    points = np.concatenate([one.vertices for one in measured.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    sides = points[points[:, 2] < mirrors_above * kind.height_m, 1]
    scale = np.array([kind.length_m, kind.width_m, kind.height_m]) / np.array(
        [high[0] - low[0], sides.max() - sides.min(), high[2]]
    )
    if np.abs(scale - 1.0).max() > 0.04:
        raise ValueError(f"{measured.name} would have to be scaled by {scale.round(3)} to have its kind's size")
    middle = np.array([(low[0] + high[0]) / 2.0, 0.0, 0.0])
    return replace(model, parts=[one.moved(-middle).turned(np.diag(scale)) for one in model.parts])


def wheel_well(x: float, z: float, radius: float, outer_y: float, inner_y: float, floor_z: float) -> Part:
    """The inside of a wheel arch in a flat side: a dark half pipe from the side inwards, and its end."""
    start = float(np.arcsin(np.clip((floor_z - z) / radius, -1.0, 1.0)))
    angle = np.linspace(start, np.pi - start, 19)
    rim = np.stack([x + radius * np.cos(angle), np.full(19, outer_y), z + radius * np.sin(angle)], axis=1)
    inner = rim.copy()
    inner[:, 1] = inner_y
    faces: list[tuple[int, ...]] = [(i, i + 1, 20 + i, 19 + i) for i in range(18)]
    faces.append(tuple(range(37, 18, -1)))
    return part("gap", np.concatenate([rim, inner]), faces)

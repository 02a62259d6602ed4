"""What an earlier layout of markings left: ghosts of worn lines, lines painted over, scars of removed ones."""

from typing import Final

import numpy as np

from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.looks.history import FormerKind
from pavetwin.scene.ground.looks.weights import pick
from pavetwin.scene.ground.markings.painter import Paint

NARROWED: Final = 0.96
"""Factor on the width of what is left of a line: its edges wear off first. Ours."""

SCAR_M: Final = 0.03
"""Removal and masking reach this far beside a line. Ours."""

AHEAD: Final = 6.0
"""A layout that was given up is moved along its lines by up to this factor on the distance to their side; one that was
painted over by no more than to their side. Ours."""

LEAST_AGE: Final = 0.2
"""Newer pavements have no earlier markings."""

KERB_M: Final = 0.15
"""Nothing of it lies nearer to a kerb."""


def former_kind(plan: SurfaceLayout, name: str) -> FormerKind | None:
    """What became of the earlier markings of a street or a crossing; None where there were none."""
    rules = plan.look.former_markings
    return (
        pick(rules.kinds, plan.chance(f"former kind {name}")) if plan.chance(f"former {name}") < rules.share else None
    )


def left_of(plan: SurfaceLayout, name: str, kind: FormerKind, earlier: Paint) -> Paint:
    """What an earlier layout left.

    Args:
        name: of the street or crossing.
        kind: what became of it.
        earlier: its bars, as if it were today's.
    """
    rules = plan.look.former_markings

    def chance(what: str) -> float:
        return plan.chance(f"former {what} {name}")

    over = kind is FormerKind.OVERPAINTED
    reach = (rules.beside_m if over else rules.moved_m).at(chance("left"))
    left = reach if chance("side") < 0.5 else -reach
    ahead = (1.0 if over else AHEAD) * reach * (2 * chance("ahead") - 1)
    _, _, to_kerb = plan.edges.locate(earlier.bars[:, :2])
    inside = to_kerb > reach + KERB_M
    bars, looks = earlier.bars[inside].copy(), earlier.bar_looks[inside].copy()
    cos, sin = np.cos(bars[:, 2]), np.sin(bars[:, 2])
    bars[:, 0] += ahead * cos - left * sin
    bars[:, 1] += ahead * sin + left * cos
    none = np.zeros((0, 2))
    if kind in (FormerKind.WORN, FormerKind.OVERPAINTED):
        bars[:, 4] *= NARROWED
        looks[:, 1] = rules.wear.at(chance("wear"))
        return Paint(bars, looks, (), none, np.ones(len(bars), dtype=np.bool_), np.zeros((0, 6)))
    bars[:, 3:] += SCAR_M
    tone = (rules.removed_tone if kind is FormerKind.REMOVED else rules.masked_tone).at(chance("tone"))
    scars = np.column_stack([bars, np.full(len(bars), tone)])
    return Paint(np.zeros((0, 5)), none, (), none, np.zeros(0, dtype=np.bool_), scars)

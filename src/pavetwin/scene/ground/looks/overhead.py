"""What hangs over streets: wires between poles, and trees without leaves."""

from typing import Annotated

from pydantic import AfterValidator

from pavetwin.config.settings import Settings, Share
from pavetwin.scene.ground.looks.values import ValueRange, Within, whole


class Overhead(Settings):
    """What hangs over streets and throws thin shadows on them."""

    wired: Share = 0.0
    """Share of the streets with poles that have wires between them."""
    wires: Annotated[ValueRange, Within(1, 6), AfterValidator(whole)] = ValueRange(least=1, most=4)
    """Number of wires on the poles of one street."""
    diameter_m: Annotated[ValueRange, Within(0.005, 0.08)] = ValueRange(least=0.012, most=0.03)
    """Diameter of a wire; bundles of insulated wires are the thickest."""
    sag: Annotated[ValueRange, Within(0.0, 0.06)] = ValueRange(least=0.01, most=0.03)
    """Sag at mid-span, relative to the span."""
    connections: Share = 0.0
    """Share of the poles with a wire to a house, mostly across the street."""
    bare_trees: Share = 0.0
    """Share of the trees without leaves."""

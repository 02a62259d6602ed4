"""What hangs over streets: wires between poles, and trees without leaves."""

from typing import Annotated

from pydantic import AfterValidator

from pavetwin.config.base import Settings
from pavetwin.config.numbers import Share
from pavetwin.scene.ground.looks.values import ValueRange, Within, whole


class Overhead(Settings):
    """What hangs over streets and throws thin shadows on them."""

    wired: Share = 0.0
    """Of streets with poles that have wires between them."""
    wires: Annotated[ValueRange, Within(1, 6), AfterValidator(whole)] = ValueRange(least=1, most=4)
    """On the poles of one street, a whole number."""
    diameter_m: Annotated[ValueRange, Within(0.005, 0.08)] = ValueRange(least=0.012, most=0.03)
    """Of a wire; bundles of insulated ones are the thickest."""
    sag: Annotated[ValueRange, Within(0.0, 0.06)] = ValueRange(least=0.01, most=0.03)
    """Of a wire's middle below its ends, × their distance."""
    connections: Share = 0.0
    """Of poles with a wire to a house, mostly over the street."""
    bare_trees: Share = 0.0
    """Of trees that have no leaves."""

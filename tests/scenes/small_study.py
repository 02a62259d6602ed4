"""A design of few missions over one world."""

from pathlib import Path

from pavetwin.experiments.design import Design


def small(world: Path, **values: object) -> Design:
    usual = {
        "worlds": [str(world)],
        "densities": ["low", "medium"],
        "altitudes_m": [6, 10],
        "policies": ["baseline", "hover"],
        "presets": ["paper"],
        "replicates": 3,
        "seed": 4,
    }
    return Design.parse(usual | values, where="the design")

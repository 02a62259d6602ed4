"""The colours of maps, pictures and reports, which the page shares: `python -m pavetwin.app.colours` writes them to
`colours.json`, which the page's tasks read without loading what draws maps."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from matplotlib.colors import to_hex

from pavetwin.draw import style
from pavetwin.draw.mission_layers import BATTERY, REVISIT, STEP, WAIT
from pavetwin.draw.mission_style import AGENT_COLOURS, HIDDEN, OPEN_DEFECT, SEEN, UAV

FILE: Final = Path(__file__).with_name("colours.json")

_SHADES: Final = 16
"""Number of visibility colours from 0 to 1."""


def page_colours() -> Mapping[str, Any]:
    """Colours of the page as `#RRGGBB`, keyed by meaning."""
    ramp = [to_hex(style.VISIBILITY(shade / (_SHADES - 1))) for shade in range(_SHADES)]
    return {
        "ground": style.GROUND,
        "park": style.PARK,
        "sidewalk": style.SIDEWALK,
        "carriageway": style.CARRIAGEWAY,
        "casing": style.CASING,
        "marking": style.MARKING,
        "building": style.BUILDING,
        "building_edge": style.BUILDING_EDGE,
        "tree": style.TREE,
        "base": style.BASE,
        "visibility": ramp,
        "outcomes": dict(style.OUTCOME_COLOURS),
        "open_defect": OPEN_DEFECT,
        "agents": dict(AGENT_COLOURS),
        "policies": dict(style.POLICY_COLOURS),
        "seen": SEEN,
        "hidden": HIDDEN,
        "uav": UAV,
        "wait": WAIT,
        "revisit": REVISIT,
        "displace": STEP,
        "battery": BATTERY,
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(page_colours(), indent=1) + "\n", encoding="utf-8")

"""The library names its parameters in backquotes (`altitude_m`); the command line names the options that give them."""

import re
from typing import Final

_SAME: Final = (
    *(
        "anchor",
        "bounds",
        "count",
        "empty",
        "force",
        "formats",
        "images",
        "jobs",
        "max_energy",
        "min_coverage",
        "order",
    ),
    *("order", "platform", "policy", "quality", "scheduler", "seed", "split", "time"),
)
"""Parameters whose options have the same name."""

FLAGS: Final = {name: f"--{name.replace('_', '-')}" for name in _SAME} | {
    "altitude_m": "--altitude",
    "altitudes_m": "--altitude",
    "count=None": "--segments all",
    "densities": "--density",
    "max_time_s": "--max-time",
    "names": "--segment",
    "overrides": "--set",
    "picture=jpg": "no --png",
    "picture=png": "--png",
    "plugins": "--plugin",
    "retry": "--retry-failed",
    "size_px": "--size",
    "texel_m": "--texel",
}
"""By parameter, or by parameter and value where an option has no value of its own."""

OF_COMMAND: Final = {("fly", "count"): "--segments"}
"""Where a command has its own option for a parameter."""


def with_flags(message: str, command: str) -> str:
    """A message of the library as the user of a command reads it. What is not in the tables stays as it is."""

    def flag(found: re.Match[str]) -> str:
        return OF_COMMAND.get((command, found[1])) or FLAGS.get(found[1], found[0])

    return re.sub(r"`([a-z_]+(?:=\w+)?)`", flag, message)

"""The library names its parameters in backquotes (`altitude_m`); the command line names the options that give them."""

import re
from typing import Final

FLAGS: Final = {
    "altitude_m": "--altitude",
    "altitudes_m": "--altitude",
    "anchor": "--anchor",
    "bounds": "--bounds",
    "count": "--count",
    "count=None": "--segments all",
    "densities": "--density",
    "empty": "--empty",
    "force": "--force",
    "formats": "--formats",
    "images": "--images",
    "jobs": "--jobs",
    "max_energy": "--max-energy",
    "max_time_s": "--max-time",
    "min_coverage": "--min-coverage",
    "names": "--segment",
    "order": "--order",
    "overrides": "--set",
    "picture=jpg": "no --png",
    "picture=png": "--png",
    "platform": "--platform",
    "plugins": "--plugin",
    "policy": "--policy",
    "quality": "--quality",
    "retry": "--retry-failed",
    "scheduler": "--scheduler",
    "seed": "--seed",
    "size_px": "--size",
    "split": "--split",
    "texel_m": "--texel",
    "time": "--time",
}
"""By parameter, or by parameter and value where an option has no value of its own."""

OF_COMMAND: Final = {("fly", "count"): "--segments"}
"""Where a command calls a parameter otherwise than the others do."""


def with_flags(message: str, command: str) -> str:
    """A message of the library as the user of a command reads it. What is not in the tables stays as it is."""

    def flag(found: re.Match[str]) -> str:
        return OF_COMMAND.get((command, found[1])) or FLAGS.get(found[1], found[0])

    return re.sub(r"`([a-z_]+(?:=\w+)?)`", flag, message)

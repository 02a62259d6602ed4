"""Hints for options that were typed from memory, and for numbers that were typed with their unit."""

from typing import Final

MEANT: Final = {
    **dict.fromkeys(("--drone", "--uav", "--uas", "--model"), ("--aircraft", "--aircraft")),
    **dict.fromkeys(("--height", "--alt", "--agl"), ("--altitude", "--altitude")),
    **dict.fromkeys(
        ("--battery", "--capacity", "--batteries"), ("--set", "--set energy.usable=0.8, or energy.reserve")
    ),
    **dict.fromkeys(("--camera",), ("--set", "--set camera.model=NAME")),
    **dict.fromkeys(("--street", "--streets"), ("--segment", '--segment "Bell Lane"')),
}
"""By an option from memory: the option that a command must have for the hint, and what to type instead."""

IN_METRES: Final = ("--altitude", "--segment-length", "--texel")

NO_NUMBER: Final = "Input should be a valid number"


def words_of(error: Exception) -> str:
    """What a wrong command line is told, in a sentence; empty where a group was given without a command, and its help
    has been printed."""
    words = _hint(error) or getattr(error, "format_message", lambda: str(error))()
    if NO_NUMBER in words:
        option = max(getattr(getattr(error, "param", None), "opts", ["a value"]), key=len)
        unit = " of metres" if option in IN_METRES else ""
        words = f"{option}: give a number{unit}, such as 10, without a unit"
    words = words.replace("Input should be", "it must be").replace(", unable to parse string as an integer", "")
    return words if not words or words.endswith((".", "?")) else f"{words}."


def _hint(error: Exception) -> str:
    typed, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    needed, meant = MEANT.get(typed or "", ("", ""))
    known = {flag for each in getattr(getattr(context, "command", None), "params", ()) for flag in each.opts}
    return f"No such option: {typed} (did you mean {meant}?)" if needed in known else ""

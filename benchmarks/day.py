"""`python -m benchmarks.day -o PICTURE fly WORLD --segments all --order near …`: memory of a long survey, and its bar.

Runs the command on a terminal of its own. Once a second the resident memory of its process and of the processes that
it started is read, and everything that its bar says of the time left is kept. Prints the peaks, and how often the time
left was right within a third; draws memory over time (`docs/images/day.png`). `--json FILE` keeps what was measured,
`--from FILE` draws it again.
"""

import argparse
import json
import os
import pty
import re
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt

from pavetwin.cli.console import out
from pavetwin.draw import style

EVERY_S: Final = 1.0
LEAST_S: Final = 10.0
"""Less time left is not judged."""

_LEFT: Final = re.compile(r"(Flying[^━╸╺%]*?) *[━╸╺]+ +(\d+) % (\d+):(\d\d):(\d\d)")
_CONTROL: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def measure(words: Sequence[str]) -> dict[str, Any]:
    """Memory in MiB of the command's process and of all others, processor seconds, and what was said, over time."""
    program = [sys.executable, "-c", "from pavetwin.cli import main; main()", *words]
    master, slave = pty.openpty()
    begun = time.monotonic()
    process = subprocess.Popen(program, stdout=slave, stderr=slave, env={**os.environ, "COLUMNS": "160"})
    os.close(slave)
    memory: list[tuple[float, float, float]] = []
    said: list[tuple[float, str]] = []
    ended = False
    while not ended:
        now = time.monotonic() - begun
        if select.select([master], [], [], 0.2)[0]:
            try:
                said.append((now, os.read(master, 1 << 16).decode(errors="replace")))
            except OSError:  # the terminal has no user any more
                ended = True
        if not memory or now - memory[-1][0] >= EVERY_S:
            own, *others = [_resident_mib(number) for number in _family(process.pid)] or [0.0]
            memory.append((now, own, sum(others)))
    code = process.wait()
    return {"words": list(words), "code": code, "memory": memory, "said": said}


def _family(number: int) -> Iterator[int]:
    yield number
    try:
        children = Path(f"/proc/{number}/task/{number}/children").read_text(encoding="ascii").split()
    except OSError:
        return
    for child in children:
        yield from _family(int(child))


def _resident_mib(number: int) -> float:
    try:
        status = Path(f"/proc/{number}/status").read_text(encoding="utf-8")
    except OSError:
        return 0.0
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return int(found[1]) / 1024 if found else 0.0


def times_left(said: Sequence[tuple[float, str]]) -> list[tuple[float, float, float]]:
    """Of each moment at which the bar of the flight was drawn: when, the seconds left that it told, and the true ones.

    The flight ends when its bar is drawn last.
    """
    told = [
        (at, 3600.0 * int(hours) + 60 * int(minutes) + int(seconds))
        for at, text in said
        for _, _, hours, minutes, seconds in _LEFT.findall(_CONTROL.sub("", text))
    ]
    return [(at, left, told[-1][0] - at) for at, left in told]


def draw(measured: Mapping[str, Any], picture: Path) -> None:
    """Memory over the minutes that the command took."""
    minutes, own, others = zip(*[(at / 60, own, others) for at, own, others in measured["memory"]], strict=True)
    flown = [at / 60 for at, _, _ in times_left(measured["said"])]
    figure, axes = plt.subplots(figsize=(7.0, 3.2))
    axes.plot(minutes, own, color=style.INK, lw=1.4, label="pavetwin fly")
    axes.plot(minutes, others, color=style.INK_SOFT, lw=1.0, ls="--", label="SUMO")
    if flown:
        axes.axvspan(min(flown), max(flown), color=style.INK_FAINT, alpha=0.15, lw=0, label="in flight")
    axes.set(xlabel="minutes since the command", ylabel="resident memory, MiB", ylim=(0, None), xlim=(0, None))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, loc="lower center")
    figure.tight_layout()
    figure.savefig(picture, dpi=140)


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.day", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/images/day.png"), metavar="PICTURE")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep what was measured")
    parser.add_argument("--from", dest="before", type=Path, metavar="FILE", help="draw what was kept")
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="COMMAND", help="such as fly WORLD --segments all")
    asked = parser.parse_args(arguments)
    measured = measure(asked.words) if asked.before is None else json.loads(asked.before.read_text(encoding="utf-8"))
    if asked.json is not None:
        asked.json.write_text(json.dumps(measured) + "\n", encoding="utf-8")
    if measured["code"]:
        out.line(_CONTROL.sub("", measured["said"][-1][1]).strip())
        return int(measured["code"])
    own, others = (max(each[column] for each in measured["memory"]) for column in (1, 2))
    out.line(f"At most {own:.0f} MiB, its other processes {others:.0f} MiB; {measured['memory'][-1][0]:.0f} s.")
    judged = [abs(left - true) <= true / 3 for _, left, true in times_left(measured["said"]) if true > LEAST_S]
    if judged:
        out.line(
            f"The time left was right within a third in {sum(judged) / len(judged):.0%} of {len(judged)} drawings."
        )
    draw(measured, asked.output)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

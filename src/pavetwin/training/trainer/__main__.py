"""`python -m pavetwin.training.trainer`: training with torch, torchvision, NumPy, Pillow and pycocotools alone."""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from pavetwin.errors import PaveTwinError
from pavetwin.perception.model_file import start_path
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.trainer import PlainLines, Trainer


def main(arguments: Sequence[str] | None = None) -> int:
    """Train as `pavetwin train` does. Exit codes: 0 finished or stopped on time, 2 an error that the user can fix."""
    parser = argparse.ArgumentParser(
        prog="pavetwin.training.trainer", description="Train the detector, or continue a run."
    )
    parser.add_argument("datasets", nargs="+", type=Path, help="folders with COCO files, or packed files")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the run")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting; may be repeated")
    parser.add_argument("--start", help="initial weights: a file, an exported model, or a detector that ships, by name")
    parser.add_argument("--stop-after", type=float, metavar="MINUTES", help="save after this time and stop")
    parser.add_argument("--device", default="", help="cpu or cuda; a graphics card by default if there is one")
    parser.add_argument("--workers", type=int, default=0, help="processes that prepare images")
    parser.add_argument("--held-gb", type=float, default=2.0, help="decoded images of each dataset kept in memory")
    parser.add_argument("--views", default="", help="processor or device; by default a graphics card with the memory")
    parser.add_argument("--compile", action="store_true", help="compile the network first, which takes a minute")
    given = parser.parse_args(arguments)
    try:
        trainer = Trainer(
            read_examples(given.datasets),
            given.output,
            TrainingOptions.parse(given.set),
            TrainingMachine(given.device, given.workers, given.held_gb, given.views, given.compile),
            PlainLines(),
            start_path(given.start) if given.start is not None else None,
        )
        finished = trainer.run(60 * given.stop_after if given.stop_after is not None else None)
    except PaveTwinError as error:
        sys.stderr.write(f"Error: {_as_typed(str(error), parser)}\n")
        return 2
    print(f"{'Finished' if finished else 'Stopped; the same command continues'}: {given.output}")
    return 0


def _as_typed(message: str, parser: argparse.ArgumentParser) -> str:
    """The message with parameters named as command-line options."""
    options = {"compiled": "--compile", "overrides": "--set"}
    options |= {name: f"--{name.replace('_', '-')}" for name in vars(parser.parse_args(["-o", "x", "x"]))}
    del options["datasets"]
    return re.sub(r"`(\w+)`", lambda found: options.get(found[1], found[0]), message)


if __name__ == "__main__":
    sys.exit(main())

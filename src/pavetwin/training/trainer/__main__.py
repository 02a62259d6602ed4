"""`python -m pavetwin.training.trainer`: training where there are only torch, torchvision, NumPy and Pillow."""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from pavetwin.errors import PaveTwinError
from pavetwin.perception.shipped import start_path
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.datasets.unlabelled import read_unlabelled
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import PlainLines


def main(arguments: Sequence[str] | None = None) -> int:
    """Train as `pavetwin train` does. Exit codes: 0 finished or stopped in time, 2 something the user can fix."""
    parser = argparse.ArgumentParser(
        prog="pavetwin.training.trainer", description="Train the detector, or go on with a run."
    )
    parser.add_argument("datasets", nargs="+", type=Path, help="folders with COCO files, or packed files")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the run")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting; may be repeated")
    parser.add_argument("--start", help="weights, an exported model, or one that ships by name, to begin with")
    parser.add_argument("--photographs", type=Path, help="folder of photographs without labels, for adaptation")
    parser.add_argument("--stop-after", type=float, metavar="MINUTES", help="save after this time, and stop")
    parser.add_argument("--device", default="", help="cpu or cuda; a graphics card where there is one unless given")
    parser.add_argument("--workers", type=int, default=0, help="processes that prepare images")
    parser.add_argument("--held-gb", type=float, default=2.0, help="decoded pictures of each dataset kept in memory")
    parser.add_argument("--views", default="", help="processor or device; a graphics card that has room unless given")
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
            read_unlabelled(given.photographs) if given.photographs is not None else None,
        )
        finished = trainer.run(60 * given.stop_after if given.stop_after is not None else None)
    except PaveTwinError as error:
        sys.stderr.write(f"Error: {_as_typed(str(error), parser)}\n")
        return 2
    print(f"{'Finished' if finished else 'Stopped; the same command goes on'}: {given.output}")
    return 0


def _as_typed(message: str, parser: argparse.ArgumentParser) -> str:
    """A message whose names of parameters are options, where there is one."""
    options = {"compiled": "--compile", "overrides": "--set"}
    options |= {name: f"--{name.replace('_', '-')}" for name in vars(parser.parse_args(["-o", "x", "x"]))}
    del options["datasets"]
    return re.sub(r"`(\w+)`", lambda found: options.get(found[1], found[0]), message)


if __name__ == "__main__":
    sys.exit(main())

"""The packed file of a recipe."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Literal

from pydantic import Field

from pavetwin.config.settings import Settings
from pavetwin.training.examples.opening import read_examples
from pavetwin.training.examples.pack import PackOptions, PackSummary, write_pack

FILE: Final = "all.pack"


class RecipePack(Settings):
    """How everything that a recipe makes is packed into one file."""

    most_mb: float = Field(default=60.0, ge=0.001, le=100_000, description="Millions of bytes, at most.")
    quality: int = Field(default=90, ge=1, le=100, description="Of WebP; lowered where the file would be too large.")
    longest_px: int | None = Field(default=None, ge=32, le=8192, description="Longer side of pictures, at most.")
    splits: tuple[Literal["train", "val", "test"], ...] = Field(
        default=("train", "val"), min_length=1, description="Splits that are packed."
    )


def pack(
    folders: Sequence[Path], file: Path, settings: RecipePack, on_progress: Callable[[float], None] | None = None
) -> PackSummary:
    """Pack folders with COCO files into one file, which replaces one that is there.

    Raises:
        PaveTwinError: there are no images, or they do not fit.
    """
    options = PackOptions(settings.most_mb, settings.quality, settings.longest_px or 0)
    return write_pack(read_examples(folders, settings.splits), file, options, on_progress)

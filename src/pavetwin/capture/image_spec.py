"""What one image of a dataset must show."""

from dataclasses import dataclass

from pavetwin.labels.classes import Category


@dataclass(frozen=True)
class ImageSpec:
    """What one image must show, and in which conditions it is taken."""

    platform: str
    index: int
    """Among its platform's images."""
    number: int
    """Unique in the dataset."""
    name: str
    """Of its files."""
    split: str
    aims: tuple[Category, ...]
    """It must show one of these classes; empty: it must show no defect."""
    density: str
    altitude_m: float | None
    """Of what flies; None where the ground resolution decides it."""
    gsd_mm: float | None
    """Ground resolution of an image that is a crop of the whole frame [mm a pixel]; None for whole images."""
    share: float
    """0 … 1, from which the platform derives its own choices."""

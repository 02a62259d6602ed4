"""A folder that is imported with what is wrong in it."""

from pathlib import Path

from pavetwin.labels.common_form import read_images
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of


def told(source: str, folder: Path) -> list[str]:
    """The report of a folder with bad files and one good image, which must be there in the end."""
    name, found = source_of(source)
    summary = import_source(name, found, folder, folder.parent / "dataset", size=ImageSize())
    assert [Path(image.original).stem for image in read_images(summary.folder)] == ["good"]
    return [f"{each.finding.value} {each}" for each in summary.report]

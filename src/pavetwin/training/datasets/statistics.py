"""What is in a dataset of the common form: instances by class, and images with labels and without, by source."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from pavetwin.training.datasets.annotated import AnnotatedImage

ALL = "all"
"""The row of sums."""


@dataclass
class DatasetCounts:
    """Counts by source."""

    instances: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled objects by source and class."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Ignored annotations by source."""
    annotated: Counter[str] = field(default_factory=Counter)
    """Images with a label, by source."""
    background: Counter[str] = field(default_factory=Counter)
    """Verified images without any, by source."""
    groups: dict[str, set[str]] = field(default_factory=dict)
    """Scenes by source."""

    def add(self, image: AnnotatedImage) -> None:
        self.annotated[image.source] += bool(image.labelled)
        self.background[image.source] += not image.labelled
        self.groups.setdefault(image.source, set()).add(image.group)
        for each in image.annotations:
            if each.ignored is not None:
                self.ignored[image.source] += 1
            elif each.category is not None:
                self.instances[image.source, each.category] += 1

    @property
    def sources(self) -> list[str]:
        return sorted(self.groups)

    def of_class(self, category: str) -> int:
        """Instances of a class over all sources."""
        return sum(self.instances[source, category] for source in self.sources)


def count_images(images: Iterable[AnnotatedImage]) -> DatasetCounts:
    """The counts of images, one in memory at a time."""
    counts = DatasetCounts()
    for image in images:
        counts.add(image)
    return counts

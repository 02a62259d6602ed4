"""The known datasets, one file each, and the registry that they are in."""

from pavetwin.training.datasets.sources.registry import SOURCES, DatasetSource, is_mapping_file, source_name, source_of

__all__ = ["SOURCES", "DatasetSource", "is_mapping_file", "source_name", "source_of"]

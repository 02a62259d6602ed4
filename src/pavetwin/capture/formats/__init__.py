"""Label files for the tools that train on them. One file per format, one registry."""

from pavetwin.capture.formats.base import FORMATS, Format, find_formats, label_format

__all__ = ["FORMATS", "Format", "find_formats", "label_format"]

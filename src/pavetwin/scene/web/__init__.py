"""A world as tiles for browsers: small quantised files in three levels of detail, made on demand."""

from pavetwin.scene.web.packing import FORMAT, WEB_LEVELS, WebLevel
from pavetwin.scene.web.town import WebExport, WebTown, export_web

__all__ = ["FORMAT", "WEB_LEVELS", "WebExport", "WebLevel", "WebTown", "export_web"]

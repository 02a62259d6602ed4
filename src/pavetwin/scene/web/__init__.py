"""A world as tiles for browsers: small quantised files in three levels of detail, made on demand."""

from pavetwin.scene.web.export import WebExport, export_web
from pavetwin.scene.web.levels import FORMAT, WEB_LEVELS, WebLevel
from pavetwin.scene.web.town import WebTown

__all__ = ["FORMAT", "WEB_LEVELS", "WebExport", "WebLevel", "WebTown", "export_web"]

"""Libraries that only an extra installs."""

from importlib import import_module
from typing import Any

from pavetwin.errors import PaveTwinError


def opencv() -> Any:
    """OpenCV.

    Raises:
        PaveTwinError: it is not installed; the message says how to get it.
    """
    try:
        return import_module("cv2")
    except ImportError as error:
        raise missing("Cut-outs", "OpenCV") from error


def missing(what: str, library: str) -> PaveTwinError:
    """The message about a library that is not installed."""
    return PaveTwinError(
        f"{what} need {library}, which is not installed; get it with `pip install 'pavetwin[augment]'`."
    )

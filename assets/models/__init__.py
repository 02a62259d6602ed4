"""One module a family of models; `load_families` finds them all."""

import importlib
import pkgutil


def load_families() -> None:
    """Imports every module of this package, and so registers their models."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")

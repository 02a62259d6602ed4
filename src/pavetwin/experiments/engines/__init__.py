"""Engines that fly the units of a study: this process, a pool of processes, or a Dask cluster."""

from pavetwin.experiments.engines.base import Engine, Listener
from pavetwin.experiments.engines.local import Pool, Single

__all__ = ["Engine", "Listener", "Pool", "Single"]

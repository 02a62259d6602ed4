"""Who flies the units of a study: this process, a pool of processes, or a Dask cluster. All give the same bytes."""

from pavetwin.experiments.engines.base import Engine, OnStand, OnUnit, Tell
from pavetwin.experiments.engines.local import Pool, Single

__all__ = ["Engine", "OnStand", "OnUnit", "Pool", "Single", "Tell"]

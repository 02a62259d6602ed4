"""pyogrio without pandas.

pyogrio loads pandas where it is installed, for data frames, which nothing here reads or writes: half a second and 52
MiB of every command that opens a world. It is imported here as if there were no pandas, and kept for this package
alone. Whoever imports it elsewhere later gets it with pandas, and with the same `from pyogrio.errors import …`.
"""

import sys
from functools import cache
from types import ModuleType
from typing import Final

_HIDDEN: Final = ("pandas", "geopandas")
_SHARED: Final = "pyogrio.errors"
"""Whose classes the compiled parts raise, of which a process has one set."""


@cache
def pyogrio() -> ModuleType:
    """The package, with `raw` and `errors`."""
    known = {*sys.modules}
    hidden = [] if "pyogrio" in known else [name for name in _HIDDEN if name not in known]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type] # None, as of what cannot be imported
    try:
        import pyogrio
        import pyogrio.errors
        import pyogrio.raw
    finally:
        for name in hidden:
            sys.modules.pop(name, None)
    if hidden:
        own = [name for name in sys.modules if name.partition(".")[0] == "pyogrio" and name != _SHARED]
        for name in own:
            if str(getattr(sys.modules[name], "__file__", "")).endswith(".py"):
                del sys.modules[name]
    package: ModuleType = pyogrio
    return package

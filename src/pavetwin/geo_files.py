"""pyogrio without pandas.

pyogrio loads pandas where it is installed, for data frames, which this package neither reads nor writes. That costs
every command that opens a world one second of processor time (1.9 s instead of 0.8 s) and 52 MiB. It is imported here
as if pandas were missing, for this package alone. A later import elsewhere gets pyogrio with pandas, and the same
`pyogrio.errors`.
"""

import sys
from functools import cache
from types import ModuleType
from typing import Final

_HIDDEN: Final = ("pandas", "geopandas")
_SHARED: Final = "pyogrio.errors"
"""Module of the classes that the compiled parts raise; a process has one set of them."""


@cache
def load_pyogrio() -> ModuleType:
    """The package, with `raw` and `errors`."""
    known = {*sys.modules}
    hidden = [] if "pyogrio" in known else [name for name in _HIDDEN if name not in known]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type] # None: cannot be imported
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

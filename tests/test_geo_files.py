"""pyogrio without pandas for this package alone, and whole for other importers."""

import subprocess
import sys

SCRIPT = """
import sys
from pathlib import Path
from pavetwin.geo_files import load_pyogrio
assert load_pyogrio() is load_pyogrio()
assert "pandas" not in sys.modules
import pyogrio
import pyogrio._compat
assert pyogrio is not load_pyogrio()
assert pyogrio._compat.pandas is not None and pyogrio._compat.pandas is sys.modules["pandas"]
assert load_pyogrio().raw is not pyogrio.raw
from pyogrio.errors import DataSourceError
for package in (load_pyogrio(), pyogrio):
    try:
        package.raw.read(Path("nowhere.gpkg"))
    except DataSourceError:
        print("refused")
assert load_pyogrio().errors.DataSourceError is DataSourceError
"""


def test_pandas_is_left_out_and_there_for_others() -> None:
    ended = subprocess.run([sys.executable, "-I", "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == ["refused", "refused"]


def test_who_has_imported_it_before_shares_it() -> None:
    script = "import pandas, pyogrio; from pavetwin.geo_files import load_pyogrio; assert load_pyogrio() is pyogrio"
    subprocess.run([sys.executable, "-I", "-c", script], check=True)

"""The map of the page: its colours are those of maps and reports, and reading them loads nothing that draws."""

import json
import subprocess
import sys

from pavetwin.app.colours import FILE, page_colours


def test_the_colours_are_those_of_maps_and_reports() -> None:
    assert json.loads(FILE.read_text(encoding="utf-8")) == page_colours(), "run `python -m pavetwin.app.colours`"


def test_the_tasks_of_the_page_draw_nothing() -> None:
    code = "import sys, pavetwin.app.tasks, pavetwin.app.street_map; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

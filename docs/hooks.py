"""Hooks of MkDocs: the command line, settings and keys of data files come from the code; decisions are listed."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
PYTHON = os.environ.get("PAVETWIN_PYTHON", str(ROOT / ".venv" / "bin" / "python"))
"""The interpreter with PaveTwin; the site's own environment does not have it."""

KEYS = re.compile(r"^<!-- keys: (\S+) -->$", re.MULTILINE)
"""Place of the table of a configuration class in a page."""

DESCRIBE = """
from functools import partialmethod

import typer
from typer.cli import get_docs_for_click
from pavetwin.cli import app

for kind in (typer.core.TyperCommand, typer.core.TyperGroup):  # whole sentences in lists of commands
    kind.get_short_help_str = partialmethod(kind.get_short_help_str, 200)
command = typer.main.get_command(app)
with command.make_context("pavetwin", [], resilient_parsing=True) as context:
    print(get_docs_for_click(obj=command, ctx=context, name="pavetwin", title="Command line"))
"""

INTRODUCTION = """
Generated from the program; `pavetwin COMMAND --help` prints the same text. Exit codes: 0 success; 1 an error in
PaveTwin, a finding of `doctor`, failed missions of a study, refused files of a dataset, or a repeated mission with
other results; 2 an error that the user can fix, described in one line; 130 interrupted; 143 terminated.
"""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add every decision to the navigation."""
    (pages,) = (entry["Decisions"] for entry in config.nav or [] if "Decisions" in entry)
    pages += sorted(f"decisions/{page.name}" for page in Path(config.docs_dir, "decisions").glob("[0-9]*.md"))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add `reference/cli.md`."""
    files.append(File.generated(config, "reference/cli.md", content=cli_page()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Insert the tables of configuration classes."""
    return KEYS.sub(lambda found: _printed("docs/keys.py", found[1]), markdown)


def cli_page() -> str:
    """Markdown page of all commands."""
    title, _, rest = _printed("-c", DESCRIBE).replace("\b", "").partition("\n")
    # The lines of an example stand together, one command a line; Markdown would run them into one paragraph.
    fenced = re.sub(r"\n\n((?:pavetwin .*\n)+)", r"\n\n```bash\n\1```\n", re.sub(r"\n{3,}", "\n\n", rest))
    return f"{title}\n{INTRODUCTION}{fenced}"


def _printed(*arguments: str) -> str:
    """Output of a Python run of PaveTwin's interpreter.

    Raises:
        PluginError: it fails.
    """
    environment = {**os.environ, "TERM": "dumb", "COLUMNS": "120"}
    done = subprocess.run([PYTHON, *arguments], cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise PluginError(f"{PYTHON} {arguments[0]} failed:\n{done.stderr}")
    return done.stdout

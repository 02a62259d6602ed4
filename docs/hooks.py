"""Hooks of MkDocs: the reference page of the command line is generated from the program; decisions are listed."""

import os
import re
import subprocess
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
PYTHON = os.environ.get("PAVETWIN_PYTHON", str(ROOT / ".venv" / "bin" / "python"))
"""The interpreter that has PaveTwin: the site is built in an environment that does not."""

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
Generated from the program: `pavetwin COMMAND --help` says the same. Exit codes: 0 done, 1 an error in PaveTwin, a
finding of `doctor`, failed missions of a study, refused files of a dataset, or other results of a mission that was
flown again, 2 something the user can fix (one line says what), 130 interrupted, 143 terminated.
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


def cli_page() -> str:
    """The Markdown page of all commands.

    Raises:
        PluginError: PaveTwin does not run here.
    """
    environment = {**os.environ, "TERM": "dumb", "COLUMNS": "120"}
    told = subprocess.run([PYTHON, "-c", DESCRIBE], capture_output=True, text=True, check=False, env=environment)
    if told.returncode != 0:
        raise PluginError(f"{PYTHON} cannot describe the command line:\n{told.stderr}")
    title, _, rest = told.stdout.replace("\b", "").partition("\n")
    # The lines of an example stand together, one command a line; Markdown would run them into one paragraph.
    fenced = re.sub(r"\n\n((?:pavetwin .*\n)+)", r"\n\n```bash\n\1```\n", re.sub(r"\n{3,}", "\n\n", rest))
    return f"{title}\n{INTRODUCTION}{fenced}"

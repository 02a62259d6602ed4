"""The documentation: its links resolve, its tables are complete, and the built site opens offline."""

import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
GENERATED = {DOCS / "reference" / "cli.md"}
"""Pages that `docs/hooks.py` generates."""

LONGEST = 120
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


def slug(heading: str) -> str:
    """MkDocs' anchor of a heading."""
    plain = re.sub(r"[`*]|\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip())


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings."""
    text = CODE.sub(lambda code: code.group().strip("`") if "\n" not in code.group() else "", page.read_text("utf-8"))
    return {slug(heading) for heading in re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)}


def broken_links(page: Path) -> Iterator[str]:
    """Links of a Markdown file to missing files or headings."""
    for target in re.findall(r"\]\(([^)\s]+)\)", CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"https?://|mailto:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        if file in GENERATED:
            continue
        if not file.exists() or (anchor and anchor not in anchors(file)):
            yield f"{page.relative_to(ROOT)}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_resolve(page: Path) -> None:
    assert list(broken_links(page)) == []


def test_lines_are_short() -> None:
    long = [
        f"{page.relative_to(ROOT)}:{number}"
        for page in PAGES
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > LONGEST and not line.startswith("|")  # rows of tables cannot be broken
    ]
    assert long == []


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    pages = {str(page.relative_to(DOCS)) for page in {*DOCS.rglob("*.md"), *GENERATED}}
    pages = {page for page in pages if not re.match(r"decisions/\d", page)}  # docs/hooks.py adds them
    assert named == pages


def test_tables_of_keys_have_a_meaning_in_every_row() -> None:
    classes = [
        name
        for page in DOCS.rglob("*.md")
        for name in re.findall(r"^<!-- keys: (\S+) -->$", page.read_text("utf-8"), re.M)
    ]
    printed = subprocess.run(
        [sys.executable, DOCS / "keys.py", *classes], capture_output=True, text=True, check=True
    ).stdout.strip()
    assert len(printed.split("\n\n")) == len(classes) > 0
    assert [row for row in printed.splitlines() if row.endswith("|  |")] == []


def test_every_snippet_has_its_file() -> None:
    for page in DOCS.rglob("*.md"):
        for name in re.findall(r'^--8<-- "(.+)"$', page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            assert (ROOT / name).is_file(), f"{page}: {name}"


LONGEST_DECISION = 275
"""Words of a decision, its headings included."""


def test_decisions_are_short_dated_and_listed() -> None:
    pages = sorted((DOCS / "decisions").glob("[0-9]*.md"))
    index = (DOCS / "decisions" / "index.md").read_text(encoding="utf-8")
    assert [int(page.name[:4]) for page in pages] == list(range(1, len(pages) + 1))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert re.search(r"^\*\d{4}-\d{2}-\d{2}\*$", text, flags=re.MULTILINE), page.name
        assert re.findall(r"^## (.+)$", text, flags=re.MULTILINE) == ["Context", "Decision", "Consequences"], page.name
        assert len(text.split()) <= LONGEST_DECISION, page.name
        assert f"({page.name})" in index


def test_the_version_is_the_same_everywhere() -> None:
    version = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]["version"]
    released = re.findall(r"^## \[(\d.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert released[0] == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_lock_covers_what_the_site_asks_for() -> None:
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]["docs"]
    locked = set(
        re.findall(r"^([\w-]+)==", (DOCS / "requirements.lock").read_text(encoding="utf-8"), flags=re.MULTILINE)
    )
    assert {re.split(r"[<>=]", spec)[0] for spec in asked} <= locked, "run `make lock`"


class Fetched(HTMLParser):
    """Resources that a browser fetches when it opens a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in ("script", "img", "iframe", "source", "video"):
            self.addresses.append(given.get("src") or "")
        if tag == "link" and given.get("rel") not in ("canonical", "edit", "next", "prev"):
            self.addresses.append(given.get("href") or "")


def fetched_elsewhere(site: Path) -> Iterator[str]:
    """Resources of a built site from another host."""
    for page in site.rglob("*.html"):
        parser = Fetched()
        parser.feed(page.read_text(encoding="utf-8"))
        yield from (f"{page.name}: {address}" for address in parser.addresses if re.match(r"(https?:)?//", address))
    for sheet in site.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8")
        yield from (f"{sheet.name}: {address}" for address in re.findall(r"url\([\"']?((?:https?:)?//[^)]+)", text))


@pytest.mark.slow
def test_the_site_is_built_without_a_dead_link_and_opens_offline() -> None:
    if shutil.which("make") is None:
        pytest.skip("there is no make")
    built = subprocess.run(["make", "docs"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    site = ROOT / "out" / "site"
    assert list(fetched_elsewhere(site)) == []
    assert "pavetwin fly" in (site / "reference" / "cli.html").read_text(encoding="utf-8")
    assert "choose_targets" in (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert "visibility.threshold" in (site / "reference" / "settings.html").read_text(encoding="utf-8")

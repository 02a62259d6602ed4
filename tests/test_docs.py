"""The documentation: its links lead somewhere, its terms are explained, and the built site opens offline."""

import json
import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from pavetwin.config import load_settings

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
GENERATED = {DOCS / "reference" / "cli.md"}
"""Made by `docs/hooks.py` while the site is built."""

LONGEST = 120
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


def slug(heading: str) -> str:
    """The anchor that MkDocs gives a heading."""
    plain = re.sub(r"[`*]|\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip())


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings."""
    text = CODE.sub(lambda code: code.group().strip("`") if "\n" not in code.group() else "", page.read_text("utf-8"))
    return {slug(heading) for heading in re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)}


def broken_links(page: Path) -> Iterator[str]:
    """The links of a Markdown file to files or headings that are not there."""
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
def test_links_lead_somewhere(page: Path) -> None:
    assert list(broken_links(page)) == []


def test_a_dead_link_and_a_dead_anchor_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there.md").write_text("# What is *here*, `now`\n", encoding="utf-8")
    page = tmp_path / "page.md"
    page.write_text("[a](there.md#what-is-here-now) [b](gone.md) [c](there.md#gone) `[d](code.md)`\n", encoding="utf-8")
    monkeypatch.setitem(broken_links.__globals__, "ROOT", tmp_path)
    assert list(broken_links(page)) == ["page.md: gone.md", "page.md: there.md#gone"]


def test_lines_are_short() -> None:
    """Rows of tables cannot be broken."""
    long = [
        f"{page.relative_to(ROOT)}:{number}"
        for page in PAGES
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > LONGEST and not line.startswith("|")
    ]
    assert long == []


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    pages = {str(page.relative_to(DOCS)) for page in {*DOCS.rglob("*.md"), *GENERATED}}
    pages = {page for page in pages if not re.match(r"decisions/\d", page)}  # docs/hooks.py adds them
    assert named == pages


def test_every_snippet_has_its_file() -> None:
    for page in DOCS.rglob("*.md"):
        for name in re.findall(r'^--8<-- "(.+)"$', page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            assert (ROOT / name).is_file(), f"{page}: {name}"


def test_decisions_are_dated_and_listed() -> None:
    pages = sorted((DOCS / "decisions").glob("[0-9]*.md"))
    index = (DOCS / "decisions" / "index.md").read_text(encoding="utf-8")
    assert [int(page.name[:4]) for page in pages] == list(range(1, len(pages) + 1))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert re.search(r"^\*\d{4}-\d{2}-\d{2}\*$", text, flags=re.MULTILINE), page.name
        assert re.findall(r"^## (.+)$", text, flags=re.MULTILINE) == ["Context", "Decision", "Consequences"], page.name
        assert f"({page.name})" in index


def test_the_lock_covers_what_the_site_asks_for() -> None:
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]["docs"]
    locked = set(
        re.findall(r"^([\w-]+)==", (DOCS / "requirements.lock").read_text(encoding="utf-8"), flags=re.MULTILINE)
    )
    assert {re.split(r"[<>=]", spec)[0] for spec in asked} <= locked, "run `make lock`"


class Fetched(HTMLParser):
    """What a browser fetches by itself when it opens a page."""

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
    """Resources of a built site that come from another host."""
    for page in site.rglob("*.html"):
        parser = Fetched()
        parser.feed(page.read_text(encoding="utf-8"))
        yield from (f"{page.name}: {address}" for address in parser.addresses if re.match(r"(https?:)?//", address))
    for sheet in site.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8")
        yield from (f"{sheet.name}: {address}" for address in re.findall(r"url\([\"']?((?:https?:)?//[^)]+)", text))


def test_a_resource_from_elsewhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(
        '<link rel="preconnect" href="https://fonts.example"><script src="assets/a.js"></script>'
        '<a href="https://example.org">a link is fetched only when clicked</a><img src="//cdn.example/b.png">',
        encoding="utf-8",
    )
    (tmp_path / "a.css").write_text("@font-face { src: url(https://fonts.example/c.woff) }", encoding="utf-8")
    assert sorted(fetched_elsewhere(tmp_path)) == [
        "a.css: https://fonts.example/c.woff",
        "index.html: //cdn.example/b.png",
        "index.html: https://fonts.example",
    ]


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


def test_the_table_of_settings_holds_every_setting_with_its_values() -> None:
    """Conditions and parked vehicles have tables of their own."""
    text = (DOCS / "reference" / "settings.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([a-z0-9_.]+)` \| (`.*?` \| (?:`.*?`)?) +\|", text, flags=re.MULTILINE))
    default, paper = (
        dict(plain_values(load_settings(preset).model_dump(mode="json"))) for preset in ("default", "paper")
    )
    expected = {
        key: f"{shown(value)} | {shown(paper[key]) if paper[key] != value else ''}"
        for key, value in default.items()
        if key.split(".")[0] not in ("conditions", "parking")
    }
    assert {key: value.strip() for key, value in rows.items() if key in default} == {
        key: value.strip() for key, value in expected.items()
    }


def plain_values(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by their full keys."""
    for name, value in values.items():
        if isinstance(value, dict) and name not in ("options", "least_px"):
            yield from plain_values(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def shown(value: Any) -> str:
    """A value as the table shows it: numbers to four digits behind the point."""
    if isinstance(value, dict):
        return "`{" + ", ".join(f"{name}: {shown(each).strip('`')}" for name, each in value.items()) + "}`"
    if isinstance(value, float):
        value = int(value) if value == int(value) else round(value, 4)
    return f"`{json.dumps(value)}`".replace('"', "")

"""What a reader's program sees of a report."""

from html.parser import HTMLParser

from pavetwin.experiments.report.study import Study
from scenes import tiny
from scenes.report_studies import SMALL, study_of, table_of


class Outline(HTMLParser):
    """What a reader's program sees of a page."""

    VOID = frozenset({"meta", "img", "br", "link", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        assert self.open == [], "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def anchors(self) -> list[str]:
        return [attributes["id"] or "" for _, attributes in self.tags if "id" in attributes]


def small_study(**design: object) -> Study:
    return study_of(table_of(SMALL, 4), worlds={"tiny": tiny.bent()}, **design)


def sections(text: str) -> set[str]:
    return {anchor for anchor in Outline(text).anchors if not anchor.startswith(("figure", "table"))}

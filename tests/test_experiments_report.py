"""The report of a study: self-contained, the same bytes twice, complete, and sensible where a study is small."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import polars as pl
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report import Study, gather, write_report
from pavetwin.experiments.report import page as pages
from pavetwin.experiments.report.maps import street_map, street_means
from pavetwin.experiments.report.plots.tradeoff import options
from scenes import tiny
from scenes.report_studies import SMALL, study_of, table_of, with_failures


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


def page(study: Study) -> str:
    return pages.page(study, pages.sections_of(study))


def small_study(**design: object) -> Study:
    return study_of(table_of(SMALL, 4), worlds={"tiny": tiny.bent()}, **design)


@pytest.fixture(scope="module")
def small() -> str:
    return page(small_study())


def sections(text: str) -> set[str]:
    return {anchor for anchor in Outline(text).anchors if not anchor.startswith(("figure", "table"))}


def test_every_section_is_there(small: str) -> None:
    results = {"means", "intervals", "differences", "tradeoffs", "spread"}
    assert sections(small) == {*results, "effects", "streets", "findings", "methods", "repeat"}


def test_the_page_needs_nothing_from_elsewhere(small: str) -> None:
    outline = Outline(small)
    assert not {"script", "link", "iframe", "object", "base"} & {tag for tag, _ in outline.tags}
    assert all((image["src"] or "").startswith("data:image/") for image in outline.all("img"))
    assert all((link["href"] or "").startswith("#") for link in outline.all("a"))
    plain = unquote(small)
    namespaces = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r"https?://[^\s'\"<>)]+", plain)) <= namespaces
    assert "@import" not in plain
    assert not re.search(r"url\((?!#)", plain), "only parts of the same drawing are referred to"


def test_links_lead_to_anchors_and_anchors_are_distinct(small: str) -> None:
    outline = Outline(small)
    assert len(outline.anchors) == len(set(outline.anchors))
    assert {(link["href"] or "")[1:] for link in outline.all("a")} <= set(outline.anchors)


def test_figures_are_numbered_and_say_what_they_show(small: str) -> None:
    outline = Outline(small)
    figures = outline.all("figure")
    assert [figure["id"] for figure in figures] == [f"figure-{number}" for number in range(1, len(figures) + 1)]
    assert len(outline.all("img")) == len(figures) == small.count("<figcaption>")
    assert all(len(image["alt"] or "") > 30 for image in outline.all("img"))


def test_vector_figures_are_well_formed(small: str) -> None:
    sources = [image["src"] or "" for image in Outline(small).all("img")]
    drawings = [source for source in sources if source.startswith("data:image/svg+xml,")]
    assert len(drawings) >= 7
    for drawing in drawings:
        text = unquote(drawing.partition(",")[2])
        root = ElementTree.fromstring(text)
        names = [part.get("id") for part in root.iter() if part.get("id")]
        assert len(names) == len(set(names))
        assert set(re.findall(r"(?:href='|url\()#([\w-]+)", text)) <= set(names)


def test_the_same_study_gives_the_same_bytes(tmp_path: Path) -> None:
    first = write_report(small_study(), tmp_path / "a")
    second = write_report(small_study(), tmp_path / "b")
    assert [path.name for path in first] == ["report.html", "table.csv", "table.md", "table.tex"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(path.name for path in first)


def test_progress_grows_to_one(tmp_path: Path) -> None:
    told: list[float] = []
    write_report(study_of(table_of({}, 2)), tmp_path, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_folder_that_cannot_be_made_is_said_plainly(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(PaveTwinError, match="Cannot write"):
        write_report(study_of(table_of({}, 1)), tmp_path / "file" / "folder")


def test_names_are_escaped() -> None:
    factors = {"policy": ("baseline", "<b>&"), "traffic": ("low", 'rush "<i>"'), "tau_o": (0.5, 0.7)}
    text = page(study_of(table_of(factors, 2), title="<script>alert(1)</script>"))
    outline = Outline(text)
    assert not {"script", "i"} & {tag for tag, _ in outline.tags}
    assert not any(attributes for attributes in outline.all("b"))
    assert "<b>&" in "".join(outline.words)
    assert "<script>alert(1)</script>" in "".join(outline.words)


def test_without_a_reference_nothing_is_compared() -> None:
    text = page(study_of(table_of({"policy": ("hover", "skip"), "altitude_m": (6.0, 10.0)}, 3)))
    assert "differences" not in sections(text)
    assert "permutation" not in text
    assert "tradeoffs" in sections(text)


@pytest.mark.parametrize("varied", ["traffic", "altitude_m", "policy"])
def test_one_level_of_the_others_is_enough(varied: str) -> None:
    text = page(study_of(table_of({varied: SMALL[varied]}, 3)))
    assert {"means", "intervals", "spread"} <= sections(text)
    assert ("differences" in sections(text)) == (varied == "policy")


def test_a_single_cell_flown_once() -> None:
    text = page(study_of(table_of({}, 1)))
    assert {"means", "spread", "methods", "repeat"} <= sections(text)
    assert not {"differences", "tradeoffs", "effects", "across", "failures", "streets"} & sections(text)


def test_failures_are_told_with_their_reasons() -> None:
    text = page(study_of(with_failures(table_of(SMALL, 4), 9, "no route to <segment>")))
    assert "failures" in sections(text)
    assert "no route to &lt;segment&gt;" in text
    assert "6 of 48 missions failed" in text


def test_statistics_need_no_columns_of_what_does_not_vary() -> None:
    table = table_of({"altitude_m": (6.0, 10.0)}, 3)
    assert page(study_of(table, sparse=True)) == page(study_of(table))


def test_all_missions_failed() -> None:
    text = page(study_of(with_failures(table_of(SMALL, 2), 1)))
    assert "failures" in sections(text)
    assert not {"means", "intervals", "spread", "tradeoffs"} & sections(text)


def test_other_factors_have_a_section_for_each_combination() -> None:
    study = study_of(table_of({"policy": ("baseline", "own"), "world": ("a", "b"), "tau_o": (0.5, 0.9)}, 2))
    text = page(study)
    found = sections(text)
    assert {"across", *(f"results-{at}" for at in range(1, 5)), "results-4-means"} <= found
    assert "Results: world a, tau_o 0.5" in text
    assert len(list(study.groups())) == 4


def test_many_combinations_are_cut_short_and_said_to_be() -> None:
    text = page(study_of(table_of({"tau_o": tuple(round(0.05 * at, 2) for at in range(1, 19))}, 2)))
    found = sections(text)
    assert "results-4-intervals" in found
    assert "results-5-intervals" not in found
    assert "results-16-means" in found
    assert "results-17" not in found
    assert "2 more combinations" in text


def test_a_swept_truth_value_is_read_in_words() -> None:
    text = page(study_of(table_of({"policy": ("baseline", "hover"), "slow": (False, True)}, 2)))
    assert "slow yes" in text


def test_the_front_is_taken_in_each_density() -> None:
    (group,) = study_of(table_of(SMALL, 4)).groups()
    for traffic in group.traffics:
        cells = options(group, traffic, metric_named("coverage"), metric_named("time_s"))
        assert len(cells) == 6
        best = max(cells, key=lambda option: float(option.gain["mean"]))
        cheapest = min(cells, key=lambda option: float(option.cost["mean"]))
        assert best.on_front
        assert cheapest.on_front


def test_streets_are_means_over_their_missions() -> None:
    table = table_of({"policy": ("baseline", "hover")}, 6)
    nothing = pl.when(pl.col("replicate") == 1).then(None).otherwise("coverage").alias("coverage")
    means = street_means(table.with_columns(nothing), "tiny")
    side = means.filter(pl.col("segment") == "side").row(0, named=True)
    of_side = table.filter(pl.col("segment") == "side", pl.col("replicate") == 4)
    assert (side["missions"], side["replicates"]) == (2, 1)
    assert side["coverage"] == pytest.approx(of_side["coverage"].mean())
    assert means["coverage"].is_sorted()


def test_a_map_shows_the_segments_that_were_flown() -> None:
    means = street_means(table_of(SMALL, 3), "tiny")
    picture = street_map(tiny.bent(), means)
    assert picture is not None
    assert picture.source.startswith("data:image/png;base64,")
    assert "2 segments" in picture.alt, "the third of the table is in no tiny world"
    assert street_map(tiny.straight(), means.filter(pl.col("segment") == "side")) is None


def test_gathered_statistics_fit_the_report() -> None:
    made_with = {"SUMO": "1.2.3", "world tiny": "0123abcd"}
    study = gather("Gathered", {"seed": 3, "version": "0.0.0", "made_with": made_with}, table_of(SMALL, 5), {})
    assert study.factors == ("traffic", "altitude_m", "policy")
    assert study.others == ()
    text = page(study)
    assert {"means", "differences", "effects", "findings"} <= sections(text)
    assert "version:" not in text, "it is no key of a design"
    assert "made_with" not in text
    assert "PaveTwin\n0.0.0, SUMO 1.2.3, world tiny 0123abcd" in text


def test_figures_are_files_too_when_they_are_asked_for(tmp_path: Path) -> None:
    study = small_study()
    plain = write_report(study, tmp_path / "plain")
    written = write_report(study, tmp_path / "all", figures=True)
    figures = [path for path in written if path.parent.name == "figures"]
    text = (tmp_path / "all" / "report.html").read_text()
    assert len(figures) == text.count("<img ") == len(written) - len(plain) > 5
    for path in figures:
        if path.suffix == ".svg":
            assert ElementTree.fromstring(path.read_text()).tag.endswith("svg")
        else:
            assert path.read_bytes().startswith(b"\x89PNG")

"""Damage populations: numbers, sizes and positions follow their files, and mistakes are reported with their place."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from shapely import Point

from pavetwin.defects import (
    DEFECT_CLASSES,
    DefectOptions,
    Heightfield,
    add_defects,
    defect_class,
    heightfield_of,
    place,
)
from pavetwin.defects.placement import SegmentPlacement
from pavetwin.defects.population import ClassPopulation, Population, population, population_names
from pavetwin.defects.poses import RoadSection
from pavetwin.defects.pothole import pothole, sample_pothole_poses
from pavetwin.defects.severity import pothole_severity
from pavetwin.defects.shapes import turned
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.world.build import BuildRecord
from pavetwin.world.model import Defect, Segment, Severity, defects_hash
from pavetwin.world.segments import segment_key
from pavetwin.world.store import load_world, save_world
from scenes import built

STREETS, PER_STREET = 400, 5


def strip(number: int, street: str, length_m: float = 100.0) -> Segment:
    y = 20.0 * number
    line = shapely.LineString([(0, y), (length_m, y)])
    polygon = line.buffer(3.5, cap_style="flat")
    return Segment(f"s{number:04d}", street, (f"e{number}",), line, polygon, 7.0, 2)


def numbers(of: Population, seed: int = 0) -> dict[str, np.ndarray]:
    """(streets, segments of each) by class: how many defects are tried on segments of 700 m²."""
    shares = of.shares()
    found = {kind.name: np.zeros((STREETS, PER_STREET)) for kind, _ in shares}
    for street in range(STREETS):
        for number in range(PER_STREET):
            segment = strip(street * PER_STREET + number, f"street {street}")
            rng = child(seed, Stream.DEFECTS, segment_key(segment))
            for kind in of.kinds_on(segment, shares, seed, rng):
                found[kind.name][street, number] += 1
    return found


def numbers_on(of: Population, segment: Segment) -> int:
    return sum(1 for _ in of.kinds_on(segment, of.shares(), 0, child(0, Stream.DEFECTS, segment_key(segment))))


def test_a_survey_has_its_density_and_shares_on_average() -> None:
    survey = population("survey")
    found = numbers(survey)
    total = sum(counts.sum() for counts in found.values())
    # 400 streets, each with a lognormal factor of sigma 0.9: the standard error of their mean is 6 %.
    assert total / (STREETS * PER_STREET * 7) == pytest.approx(survey.density.per_100_m2, rel=0.2)
    weights = {name: of_class.weight for name, of_class in survey.classes.items()}
    for name, counts in found.items():
        assert counts.sum() / total == pytest.approx(weights[name] / sum(weights.values()), rel=0.3)


def test_segments_of_one_street_are_alike_and_streets_differ() -> None:
    survey = population("survey")
    counts = numbers(survey)["single_crack"]
    pairs = np.corrcoef(np.log1p(counts[:, 0]), np.log1p(counts[:, 1]))[0, 1]
    assert pairs > 0.6
    even = survey.model_copy(update={"density": survey.density.model_copy(update={"street_sigma": 0.0})})
    counts = numbers(even)["single_crack"]
    assert abs(np.corrcoef(np.log1p(counts[:, 0]), np.log1p(counts[:, 1]))[0, 1]) < 0.2


def test_the_default_population_is_that_of_surveys() -> None:
    assert add_defects(built("cross"), DefectOptions(per_segment=0)).record.defects["population"] == "survey"
    recorded = BuildRecord(source="town.osm", defects={"population": "paper", "per_segment": 30.0, "mix": {}})
    assert DefectOptions.of_record(recorded) == DefectOptions(population="paper", per_segment=30)
    assert DefectOptions.of_record(BuildRecord(source="town.osm")) == DefectOptions(population="survey")


def test_a_density_varies_as_much_as_its_sigma() -> None:
    """Mean and variance of a Poisson number whose mean is lognormal: var − mean = mean² (exp σ² − 1)."""
    of = Population.parse(
        {"title": "even", "density": {"per_100_m2": 4.0, "segment_sigma": 0.5}, "classes": {"pothole": {"weight": 1}}},
        where="test",
    )
    counts = numbers(of)["pothole"].ravel()
    sigma = math.sqrt(math.log(1 + (counts.var() - counts.mean()) / counts.mean() ** 2))
    assert counts.mean() == pytest.approx(28, rel=0.05)
    assert sigma == pytest.approx(0.5, abs=0.05)


def test_networks_are_more_frequent_among_many_cracks() -> None:
    found = numbers(population("survey"))
    cracks, networks = found["single_crack"].sum(axis=1), found["crocodile_crack"].sum(axis=1)
    worn = cracks > np.median(cracks)
    assert networks[worn].sum() / cracks[worn].sum() > 1.3 * networks[~worn].sum() / cracks[~worn].sum()


def test_sizes_are_lognormal_within_their_limits() -> None:
    size = population("survey").classes["pothole"].sizes["diameter_m"]
    rng = np.random.default_rng(3)
    drawn = np.array([size.draw(rng, {}) for _ in range(4000)])
    assert np.median(drawn) == pytest.approx(size.median, rel=0.03)
    assert np.log(drawn).std() == pytest.approx(size.sigma, rel=0.1)
    assert drawn.min() >= size.least
    assert drawn.max() <= size.most


def test_cracks_are_wider_on_worn_pavement_and_keep_the_median_of_the_file() -> None:
    survey = population("survey")
    cracks, size = survey.classes["single_crack"], survey.classes["single_crack"].sizes["width_m"]
    counts, widths, relative = [], [], []
    for street in range(STREETS):
        segment = strip(street, f"street {street}")
        worn = survey.worn("single_crack", segment, 0)
        counts.append(numbers_on(survey, segment))
        widths.append(dict(cracks.parameters(np.random.default_rng(street), worn))["width_m"])
        relative.append(worn)
    order = np.argsort(widths)
    below = np.cumsum(np.array(counts)[order]) / sum(counts)
    assert np.array(widths)[order][np.searchsorted(below, 0.5)] == pytest.approx(size.median, rel=0.2)
    assert np.corrcoef(np.log(relative), np.log(widths))[0, 1] > 0.15
    (plain, wide) = (dict(cracks.parameters(np.random.default_rng(1), worn))["width_m"] for worn in (1.0, 4.0))
    assert wide / plain == pytest.approx(4**size.growth, rel=1e-3)
    even = survey.model_copy(
        update={"density": survey.density.model_copy(update={"per_segment": 5, "per_100_m2": None})}
    )
    assert even.worn("single_crack", strip(0, "street 0"), 0) == 1.0


@pytest.mark.parametrize("growth", [0.0, 1.0])
def test_the_median_of_a_size_holds_over_all_defects_however_their_class_grows(growth: float) -> None:
    """Half of them lie on worse segments than the one with the median of the file."""
    size = {"median": 0.4, "sigma": 0.1, "least": 0.05, "most": 4.0, "growth": 1.0}
    holes = {"weight": 1, "growth": growth, "sizes": {"diameter_m": size}}
    density = {"per_100_m2": 1.0, "segment_sigma": 0.7}
    of = Population.parse({"title": "t", "density": density, "classes": {"pothole": holes}}, "t")
    rng, worn, sizes = np.random.default_rng(1), [], []
    for number in range(1200):
        segment = strip(number, f"street {number}")
        here = of.worn("pothole", segment, 0)
        for _ in range(numbers_on(of, segment)):
            worn.append(here)
            sizes.append(dict(of.of_class("pothole").parameters(rng, here))["diameter_m"])
    assert len(sizes) == pytest.approx(1200 * 7, rel=0.1)
    assert np.mean(np.array(worn) > 1) == pytest.approx(0.5, abs=0.06)
    assert np.median(sizes) == pytest.approx(0.4, rel=0.1)


def test_a_class_lies_within_two_others_in_the_shares_that_are_given() -> None:
    of = ClassPopulation(weight=1, within={"single_crack": 0.3, "crocodile_crack": 0.5})
    found = Counter(of.host(seed) for seed in range(3000))
    shares = {host: count / 3000 for host, count in found.items()}
    assert shares == pytest.approx({"single_crack": 0.3, "crocodile_crack": 0.5, None: 0.2}, abs=0.03)


def test_a_size_can_follow_another() -> None:
    networks = population("survey").classes["crocodile_crack"]
    drawn = [dict(networks.parameters(np.random.default_rng(seed))) for seed in range(200)]
    lengths, widths = (np.array([each[name] for each in drawn]) for name in ("length_m", "width_m"))
    assert np.corrcoef(np.log(lengths), np.log(widths))[0, 1] > 0.7
    assert np.median(widths / lengths) == pytest.approx(0.67, abs=0.06)


@pytest.mark.slow
def test_a_placed_shape_has_the_size_that_was_drawn_and_comes_back_from_a_file(tmp_path: Path) -> None:
    whole = add_defects(built("cross"), DefectOptions(population="survey", per_100_m2=4))
    save_world(whole, tmp_path / "w")
    again = load_world(tmp_path / "w")
    assert again.defects == whole.world.defects
    assert again.defects_hash == whole.world.defects_hash
    assert {"single_crack", "crocodile_crack"} <= {defect.kind for defect in again.defects}
    for defect in again.defects:
        drawn = dict(defect.parameters)
        shape = heightfield_of(defect)
        corners = turned(np.asarray(shape.outline.exterior.coords)[:-1], defect.yaw_rad)
        moved = shapely.Polygon(corners + (defect.centre.x, defect.centre.y))
        assert moved.symmetric_difference(defect.polygon).area < 0.01 * defect.polygon.area + 1e-4
        if defect.kind == "pothole":
            west, _, east, _ = shape.outline.bounds
            assert east - west == pytest.approx(drawn["diameter_m"], abs=0.4)
    cracks = [defect for defect in again.defects if defect.kind == "single_crack"]
    asked, got = (
        np.array(each) for each in zip(*((dict(c.parameters)["width_m"], c.width_m) for c in cracks), strict=True)
    )
    assert np.corrcoef(np.log(asked), np.log(got))[0, 1] > 0.8


def test_defects_without_parameters_keep_their_hash() -> None:
    placed = place(built("cross").world.segments[:1], 1, DefectOptions(population="survey", per_segment=6))
    plain = [replace(defect, parameters=()) for defect in placed]
    assert defects_hash(plain) != defects_hash(placed)
    hole = Defect(
        id=0, segment="s0001", kind="pothole", centre=Point(1, 2), polygon=shapely.box(0, 1, 2, 3), seed=7, yaw_rad=0.5,
        severity=Severity.LOW, width_m=0.3, depth_m=0.04, length_m=0.0, volume_m3=0.001,
    )  # fmt: skip
    assert defects_hash([hole]) == "9e4da111d370c22f5637862f3cbe31c92013d54039c80f7bb947b9dfe1379893"


@pytest.mark.slow
def test_potholes_lie_next_to_networks_if_the_population_asks_for_it() -> None:
    survey = population("survey")
    segments = [strip(number, "one street", 60.0) for number in range(12)]

    def distances(beside: float) -> list[float]:
        near = {"crocodile_crack": {"share": beside, "along_m": 1.2, "across_m": 0.8}} if beside else {}
        classes = {
            "crocodile_crack": {**_values("crocodile_crack"), "weight": 1, "near": {}, "on_slabs": None},
            "pothole": {**_values("pothole"), "weight": 2, "near": near},
        }
        of = Population.parse(
            {"title": "t", "density": {"per_100_m2": 2, "segment_sigma": 0.1}, "classes": classes}, "t"
        )
        found = []
        for segment in segments:
            shares = of.shares()
            own = list(SegmentPlacement(segment, 4, of, shares).defects())
            networks = [defect.polygon for defect in own if defect.kind == "crocodile_crack"]
            holes = [defect.polygon for defect in own if defect.kind == "pothole"]
            found += [min(hole.distance(network) for network in networks) for hole in holes if networks]
        return found

    def _values(name: str) -> dict[str, object]:
        return survey.classes[name].model_dump()

    near, anywhere = distances(1.0), distances(0.0)
    assert len(near) > 40
    assert np.median(near) < 0.4, "as close as there is room, not only near"
    assert np.median(near) < 0.3 * np.median(anywhere)


def test_cracks_follow_the_weights_of_positions() -> None:
    cracks = population("survey").classes["single_crack"].model_copy(update={"positions": {"across": 1.0}, "near": {}})
    kind = DEFECT_CLASSES.get("single_crack")
    drawn = cracks.poses(np.random.default_rng(1), kind, RoadSection(100.0, 7.0, 2), 500)
    turns = np.abs(np.sin(drawn[:, 2]))
    assert (turns > 0.9).all()


def test_a_number_per_segment_replaces_the_density_and_keeps_the_sizes() -> None:
    segments = built("cross").world.segments[:4]
    placed = place(segments, 1, DefectOptions(population="survey", per_segment=5))
    counts = Counter(defect.segment for defect in placed)
    assert set(counts.values()) == {5}
    assert all(defect.parameters for defect in placed)
    assert place(segments, 1, DefectOptions(population="paper", per_segment=5))[0].parameters == ()


@pytest.fixture
def wide_holes() -> Iterator[str]:
    @defect_class(
        "wide_hole", sample_poses=sample_pothole_poses, rate=pothole_severity, width=lambda m: m.diameter_m, weight=1.0
    )
    def wide_hole(rng: np.random.Generator) -> Heightfield:
        return pothole(rng)

    yield "wide_hole"
    DEFECT_CLASSES.restore("wide_hole", None)


def test_a_user_class_is_placed_with_its_weight_in_addition_to_a_population(wide_holes: str) -> None:
    shares = {kind.name: share for kind, share in DefectOptions(population="survey").effective().shares()}
    assert shares[wide_holes] == pytest.approx(0.5)
    assert shares["single_crack"] == pytest.approx(0.438)
    done = add_defects(built("cross"), DefectOptions(population="survey", per_segment=1))
    assert set(done.record.defects["mix"]) == set(shares)


SURVEY = yaml.safe_load("title: t\ndensity: {per_100_m2: 2}\nclasses: {pothole: {weight: 1}}")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": {"pothol": {"weight": 1}}}, "did you mean 'pothole'"),
        (
            {"classes": {"pothole": {"weight": 1, "sizes": {"diameter_m": {"median": 1, "least": 2, "most": 1}}}}},
            "least 2",
        ),
        (
            {"classes": {"pothole": {"weight": 1, "sizes": {"diameter_m": {"median": 36, "least": 36, "most": 36}}}}},
            "36 m is more than the 5 m that are possible",
        ),
        ({"classes": {"pothole": {"weight": 1, "context": {"lane_joint": 0.2}}}}, "parameters wander and branches"),
        (
            {"classes": {"pothole": {"weight": 1, "on_slabs": "crack"}}},
            "classes.pothole.on_slabs: 'crack' is not listed",
        ),
        (
            {"classes": {"pothole": {"weight": 1, "near": {"single_crack": {"share": 1, "along_m": 1}}}}},
            "not listed before",
        ),
        (
            {"classes": {"pothoel": {"weight": 1}, "single_crack": {"weight": 1, "within": {"pothole": 0.1}}}},
            "classes.pothoel: no defect class 'pothoel' (did you mean 'pothole'?)",
        ),
        ({"classes": {"pothole": {"weight": 0}}}, "sum to 0"),
        ({"density": {"per_100_m2": 2, "per_segment": 3}}, "either"),
        ({"density": {"per_segment": 3, "street_sigma": 1}}, "per_100_m2"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_with_its_place(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({**SURVEY, **change}), encoding="utf-8")
    with pytest.raises(PaveTwinError) as caught:
        population(str(path))
    assert message in str(caught.value)
    assert "mine.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"title: t\n\tdensity: {per_segment: 3}\n", "line 2, column 1: a tab, where YAML takes spaces"),
        (b"title: t\ndensity\nclasses: {}\n", "line 3, column 1: could not find expected"),
        (b"title: t\nmix: {pothole: 1\nclasses: {}\n", "but got ':', in the braces that open in line 2"),
        (b"title: 't\nclasses: {}\n", "end of stream, in the quoted text that begins in line 1"),
        (b"", "is empty"),
        (b"- title\n", "a list of keys with values is expected"),
        (b"title: \xff", "it is not text in UTF-8"),
        (b"density: {per_segment: 3}", "title: it must be given"),
    ],
)
def test_a_file_that_is_no_settings_file_is_one_line(tmp_path: Path, text: bytes, message: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(text)
    with pytest.raises(PaveTwinError) as caught:
        population(str(path))
    assert message in str(caught.value)
    assert "mine.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_and_a_missing_file_are_reported(tmp_path: Path) -> None:
    (tmp_path / "folder.yaml").mkdir()
    for name, message in (("folder.yaml", "is a directory"), ("missing.yaml", "no such file")):
        with pytest.raises(PaveTwinError, match=f"{name}' cannot be read: {message}"):
            population(str(tmp_path / name))


def test_unknown_populations_are_refused_with_the_nearest() -> None:
    with pytest.raises(PaveTwinError, match="did you mean 'survey'"):
        DefectOptions(population="survy").effective()
    with pytest.raises(PaveTwinError, match="cannot be read"):
        DefectOptions(population="nowhere/mine.yaml").effective()


@pytest.mark.parametrize("name", population_names())
def test_populations_that_ship_fit(name: str) -> None:
    assert population(name).title

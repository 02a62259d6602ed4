"""Conformance rules of user classes of defects, and messages for broken ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pavetwin import plugins
from pavetwin.defects import DEFECT_CLASSES, DefectKind, DefectOptions, Heightfield, LabelRule, Marking, Stains, kinds
from pavetwin.defects.placement import place
from pavetwin.defects.registry import check_defect_class
from pavetwin.errors import PaveTwinError
from scenes import built
from scenes.command_line import pavetwin, plain_refusal

CLASS = """
import numpy as np
from pavetwin.defects import Heightfield, Marking, Stains, defect_class
from pavetwin.defects.poses import poses, wheel_paths
from pavetwin.world import Severity

def sample(rng, road, count):
    return poses(rng, wheel_paths(rng, road, count), 0.0, 0.1)

def rate(sizes):
    return Severity.LOW

@defect_class("dent", sample_poses=sample, rate=rate, width=lambda sizes: sizes.extent_width_m, weight=1.0)
def dent(rng):
    height = np.zeros((60, 80), dtype=np.float32)
    height[20:40, 20:60] = -rng.uniform(0.01, 0.02)
    clean = np.zeros_like(height)
    return Heightfield(height, clean, clean, 0.005, (-0.2, -0.15), Marking(0.0, 0.0), lambda: Stains.none((60, 80)))
"""


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_loaded", {})
    monkeypatch.setattr(DEFECT_CLASSES, "_entries", dict(DEFECT_CLASSES._entries))


def file(folder: Path, before: str = "", after: str = "") -> Path:
    path = folder / "dent.py"
    assert before in CLASS
    path.write_text(CLASS.replace(before, after, 1) if before else CLASS, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name)
def test_every_class_keeps_the_rules(kind: DefectKind) -> None:
    assert check_defect_class(kind, 6) == []


BROKEN = {
    "its function fails: ZeroDivisionError": ("height[20:40", "1 / 0; height[20:40"),
    "equal generators give different shapes": ("rng.uniform(0.01, 0.02)", "np.random.uniform(0.01, 0.02)"),
    "its heights are not finite": ("-rng.uniform(0.01, 0.02)", "-np.inf"),
    "does not lie around the origin": ("(-0.2, -0.15)", "(3.0, 3.0)"),
    "reaches the border of the field": ("height[20:40, 20:60]", "height[:40, 20:60]"),
    "changes the road outside its outline": ("-rng.uniform", "height[2, 2] = -rng.uniform"),
    "not deeper than 0 and at most 0.5 m": ("rng.uniform(0.01, 0.02)", "2.0"),
    "`rate` gives 'low', not a Severity": ("return Severity.LOW", "return 'low'"),
    "`width` gives nan": ("sizes.extent_width_m", "float('nan')"),
    "`width` gives 7.0": ("sizes.extent_width_m", "7.0"),
    "not finite numbers of shape": (
        "return poses(rng, wheel_paths(rng, road, count), 0.0, 0.1)",
        "return np.ones((count, 2))",
    ),
    "proposes different poses": ("return poses(rng,", "return poses(np.random.default_rng(),"),
    "finds room on a straight road": ("wheel_paths(rng, road, count)", "np.full(count, 30.0)"),
    "not a Heightfield": ("    return Heightfield", "    return None or 3 or Heightfield"),
}


@pytest.mark.parametrize("words", BROKEN)
def test_each_broken_rule_is_reported(words: str, tmp_path: Path) -> None:
    before, after = BROKEN[words]
    path = file(tmp_path, before, after)
    plugins.load_plugins([path], check=False)
    rules = check_defect_class(DEFECT_CLASSES.get("dent"), 20)
    assert any(words in rule for rule in rules), rules


def test_a_label_rule_holds_sizes(tmp_path: Path) -> None:
    plugins.load_plugins([file(tmp_path)])
    kind = DEFECT_CLASSES.get("dent")
    assert check_defect_class(kind, 1) == []
    assert "least_contrast=-1" in check_defect_class(replace(kind, label=LabelRule(least_contrast=-1)), 1)[0]
    turned = LabelRule(least_side_px=4, least_short_side_px=8)
    assert "longer than the longer" in check_defect_class(replace(kind, label=turned), 1)[0]


def test_a_class_that_fails_later_is_named_with_its_file_and_line(tmp_path: Path) -> None:
    # Both shapes that are tried when the file is read are good.
    path = file(tmp_path, "    height = np", "    if rng.random() < 0.3: raise KeyError('deep')\n    height = np")
    plugins.load_plugins([path], check=False)
    line = path.read_text().splitlines().index("    if rng.random() < 0.3: raise KeyError('deep')") + 1
    with pytest.raises(PaveTwinError) as caught:
        place(built("cross").world.segments[:2], 1, DefectOptions(population="paper", per_segment=20, mix={"dent": 1}))
    assert str(caught.value) == f"The defect class 'dent' failed: KeyError: 'deep' ({path}, line {line})."


def test_a_broken_class_is_refused_before_anything_is_built(tmp_path: Path) -> None:
    path = file(tmp_path, "return Severity.LOW", "return sizes.depth")
    message = plain_refusal(
        pavetwin("world", "build", "--generate", "grid", "-o", tmp_path / "w", "--plugin", path, cwd=tmp_path)
    )
    assert "the defect class 'dent' breaks a rule: `rate` fails: AttributeError" in message
    assert f"{path}, line 11" in message
    assert not (tmp_path / "w").exists()


def test_a_check_prints_sizes_or_what_breaks(tmp_path: Path) -> None:
    done = pavetwin("defect", "check", file(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "dent: follows all rules." in done.stdout
    assert "0.2" in done.stdout
    assert "50 low" in done.stdout
    assert "50 of 50" in done.stdout
    path = file(tmp_path, "return Severity.LOW", "return sizes.depth")
    path.write_text(path.read_text().replace("-rng.uniform(0.01, 0.02)", "-np.inf"))
    refused = pavetwin("defect", "check", path)
    assert "more; --verbose lists them" in plain_refusal(refused)
    everything = pavetwin("defect", "check", path, "--verbose")
    assert "heights are not finite" in everything.stdout
    assert "`rate` fails" in everything.stdout
    assert "registers no defect class" in plain_refusal(pavetwin("defect", "check", _empty(tmp_path)))
    assert "no defect class 'dint' (did you mean 'dent'?)" in plain_refusal(
        pavetwin("defect", "check", f"{file(tmp_path)}:dint")
    )


def _empty(folder: Path) -> Path:
    (folder / "empty.py").write_text("", encoding="utf-8")
    return folder / "empty.py"


def test_stains_that_differ_are_found() -> None:
    kind = DEFECT_CLASSES.get("pothole")

    def stained(rng: np.random.Generator) -> Heightfield:
        shape = kind.generate(rng)

        def paint() -> Stains:
            clean = Stains.none(shape.shape)
            return replace(clean, dirt=np.full(shape.shape, np.random.random(), dtype=np.float32))

        return replace(shape, paint=paint, marking=Marking(0.0, 0.0))

    assert any("different stains" in rule for rule in check_defect_class(replace(kind, generate=stained), 1))

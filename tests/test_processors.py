"""Worlds and missions are the same to the byte on processors whose vector instructions round otherwise."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.config.mission import PolicySettings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.policies import Action, Displace
from pavetwin.policies.builtin import Micro
from pavetwin.twin import Snapshot
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.store import save_world
from scenes.command_line import pavetwin_process
from scenes.tiny import SCENES

VECTORISED = (
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "cbrt"),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
)


def move_last_digits(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Half of all results of these functions are the next number up or down, the same for the same result.

    Returns:
        How many results were moved so far.
    """
    moved = [0]

    def off_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
        def computed(*arguments: Any, **options: Any) -> Any:
            exact = function(*arguments, **options)
            values = np.asarray(exact)
            if not np.issubdtype(values.dtype, np.floating):
                return exact
            bits = np.ascontiguousarray(values).view(f"i{values.dtype.itemsize}").reshape(values.shape).astype(np.int64)
            draw = (bits * np.int64(-7046029254386353131)) >> 62
            target = np.where(draw == 1, np.inf, np.where(draw == -1, -np.inf, values)).astype(values.dtype)
            off = np.where(np.isin(values, (0.0, 1.0, -1.0)), values, np.nextafter(values, target))
            moved[0] += int((off != values).sum())
            if isinstance(exact, np.ndarray):
                exact[...] = off
                return exact
            return off[()]

        return computed

    for name in VECTORISED:
        monkeypatch.setattr(np, name, off_by_one(getattr(np, name)))
    return lambda: moved[0]


CROSSING = Path(__file__).resolve().parent / "scenes" / "cross.osm"


@pytest.mark.slow
def test_a_world_is_the_same_with_other_last_digits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def content(folder: Path) -> str:
        built = build_world(CROSSING, BuildOptions(seed=3))
        return save_world(add_defects(built, DefectOptions(per_100_m2=0.1)), folder).content_hash

    here = content(tmp_path / "here")
    moved = move_last_digits(monkeypatch)
    assert content(tmp_path / "there") == here
    assert moved() > 100


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("scene", ["truck_beside_defects", "lively_street"])
def test_a_displacement_is_the_same_with_other_last_digits(scene: str, seed: int) -> None:
    """Candidates off by a nanometre, in a kernel that counts cells: as many are seen, and the same one is chosen."""

    class Moved(Micro):
        def __init__(self, settings: PolicySettings) -> None:
            super().__init__(settings)
            self.exact, rng = self.candidates, np.random.default_rng(seed)
            self.candidates = self.exact + rng.uniform(-1e-9, 1e-9, self.exact.shape)

        def decide(self, snapshot: Snapshot) -> Action:
            chosen = super().decide(snapshot)
            if not isinstance(chosen, Displace):
                return chosen
            (index,) = np.flatnonzero((self.candidates == (chosen.east_m, chosen.north_m)).all(axis=1))
            return Displace(*map(float, self.exact[index]))

    here, there = SCENES[scene]().fly("micro"), SCENES[scene]().fly(Moved(PolicySettings()))
    assert [action.action for action in here.actions].count("displace") > 0
    assert here.actions == there.actions


@pytest.mark.slow
def test_a_town_and_its_missions_are_the_same_to_the_byte_by_the_fewest_instructions(tmp_path: Path) -> None:
    """All that this processor can, AVX-512 where it has it, and the least that NumPy and BLAS run on."""
    fewest = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(np.show_config(mode="dicts")["SIMD Extensions"]["found"]),
        "OPENBLAS_CORETYPE": "Prescott",
    }
    made = []
    for folder, features in ((tmp_path / "all", {}), (tmp_path / "fewest", fewest)):
        folder.mkdir()
        environment = {**os.environ, **features, "PAVETWIN_CACHE": str(folder / "cache")}
        build = ("world", "build", "--generate", "town", "--seed", "1", "--defects-per-segment", "4", "-o", "town")
        fly = ("fly", "town", "--segments", "2", "--density", "high", "--policy", "all", "--no-map", "-o", "flown")
        for words in (build, fly):
            done = pavetwin_process(*words, cwd=folder, env=environment)
            assert done.returncode == 0, done.stderr
        files = sorted(path for kind in ("parquet", "gpkg", "csv", "geojson") for path in folder.rglob(f"*.{kind}"))
        made.append({str(path.relative_to(folder)): path.read_bytes() for path in files})
    every, few = made
    assert every.keys() == few.keys()
    assert [name for name, content in every.items() if few[name] != content] == []
    assert len(every) > 20

"""Shipped data files (street styles, pavements, marks, marking standards, damage populations), and mistakes in them."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from pavetwin.config.named import names_in
from pavetwin.defects.population import population
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground.styles.marking_standard import mark, marking_standard
from pavetwin.scene.ground.styles.pavement import PACKAGE, pavement
from pavetwin.scene.ground.styles.street_style import street_style

READERS: Final[dict[str, tuple[str, str, Callable[[str], Any]]]] = {
    "population": ("pavetwin.defects", "populations", population),
    "street style": (PACKAGE, "streets", street_style),
    "pavement": (PACKAGE, "pavements", pavement),
    "mark": (PACKAGE, "marks", mark),
    "marking standard": (PACKAGE, "standards", marking_standard),
}


def shipped(kind: str) -> list[str]:
    package, folder, _ = READERS[kind]
    return list(names_in(package, folder))


@pytest.mark.parametrize("kind", READERS)
def test_every_shipped_file_is_read(kind: str) -> None:
    assert shipped(kind)
    for name in shipped(kind):
        assert READERS[kind][2](name) is not None


@pytest.mark.parametrize("kind", READERS)
def test_an_unknown_key_is_reported_with_its_file(kind: str, tmp_path: Path) -> None:
    package, folder, read = READERS[kind]
    values = yaml.safe_load((files(package) / folder / f"{shipped(kind)[0]}.yaml").read_text(encoding="utf-8"))
    values["colur"] = 1
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(values), encoding="utf-8")
    with pytest.raises(PaveTwinError) as caught:
        read(str(path))
    assert "mine.yaml" in str(caught.value)
    assert "colur" in str(caught.value)
    assert "\n" not in str(caught.value)

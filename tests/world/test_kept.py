"""What names the code that makes what is kept in the cache; the files themselves are tested with the scenes."""

from enum import Enum, StrEnum
from pathlib import Path

import pytest

from pavetwin.world import cache as kept


class Kind(Enum):
    CRACK = 1


class Look(StrEnum):
    WORN = "worn"


def test_bytecode_and_hidden_files_are_no_part_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They appear and go while other processes start."""
    package = tmp_path / "pavetwin"
    for folder in ("world", "defects"):
        (package / folder / "__pycache__").mkdir(parents=True)
        (package / folder / "rule.py").write_text(folder)
    code = package / "arrays.py"
    code.write_text("a = 1\n")
    for module in (kept.seeds, kept.arrays):
        monkeypatch.setattr(module, "__file__", str(code))
    made_by = kept.made_by.__wrapped__
    before = made_by("world", "defects")
    for name in ("__pycache__/model.cpython-311.pyc", "__pycache__/model.cpython-311.pyc.140234", ".model.py.swp"):
        (package / "world" / name).write_bytes(b"x")
    assert made_by("world", "defects") == before
    (package / "world" / "levels.yaml").write_text("b: 2\n")
    assert made_by("world", "defects") != before
    assert made_by("defects") not in (before, made_by("world", "defects"))


@pytest.mark.parametrize(
    "reduced", [Enum.__reduce_ex__, lambda member, _protocol: (getattr, (type(member), member.name))]
)
def test_members_of_enumerations_are_read_again(
    reduced: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also those that are pickled by their name, as Python 3.11.2 does."""
    for each in (Kind, Look):
        monkeypatch.setattr(each, "__reduce_ex__", reduced)
    store, value = kept.ValueStore("values", (Kind, Look)), ([Kind.CRACK, Look.WORN], {Look.WORN: Kind.CRACK})
    assert store.kept(tmp_path / "value", lambda: value) == value
    assert store.kept(tmp_path / "value", lambda: pytest.fail("made, and not read")) == value

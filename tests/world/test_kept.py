"""What names the code that makes what is kept in the cache; the files themselves are tested with the scenes."""

from pathlib import Path

import pytest

from pavetwin.world import kept


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

"""`pavetwin world build` and `info` as a user types them."""

import sys
from pathlib import Path

import pytest

from pavetwin.cli import main
from scenes import scene_file


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run one command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["pavetwin", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_build_and_info_say_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target = str(tmp_path / "cross")
    assert run(monkeypatch, "world", "build", str(scene_file("cross")), "-o", target, "--defects-per-segment", "4") == 0
    said = capsys.readouterr().out
    for word in ("segments", "lanes", "sidewalks", "1 traffic lights", "5 from the source", "by rule", "defects"):
        assert word in said
    assert run(monkeypatch, "world", "info", target) == 0
    assert "14 (" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.osm", "-o", "x"], "does not exist"),
        (["-o", "x"], "either a SOURCE file or --generate"),
        (["--generate", "town"], "with -o"),
        (["--generate", "toun", "-o", "x"], "did you mean 'town'"),
        (["--generate", "town", "-o", "x", "--anchor", "100,0"], "no place"),
        (["--generate", "town", "-o", "x", "--seed", "-1"], "seed"),
        (["--generate", "town", "-o", "x", "--segment-length", "5"], "segment_length_m"),
        (["--generate", "grid", "-o", "x", "--defects-per-segment", "-2"], "per_segment"),
        (["--generate", "grid", "-o", "/proc/nothing/x"], "Cannot write"),
    ],
)
def test_mistakes_are_one_plain_line_and_leave_nothing(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "world", "build", *words) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("Error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert list(tmp_path.iterdir()) == []


def test_a_mistake_of_ours_is_one_line_that_asks_for_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_folder: Path) -> None:
        raise KeyError("nobody thought of this")

    monkeypatch.delenv("PAVETWIN_DEBUG", raising=False)
    monkeypatch.setattr("pavetwin.world.store.load_world", broken)
    assert run(monkeypatch, "world", "info", "anywhere") == 1
    words = capsys.readouterr().err
    assert words.count("\n") == 1
    assert "Unexpected failure: KeyError: 'nobody thought of this'. Please report it" in words
    monkeypatch.setenv("PAVETWIN_DEBUG", "1")
    monkeypatch.setattr(sys, "argv", ["pavetwin", "world", "info", "anywhere"])
    with pytest.raises(KeyError):
        main()


def test_info_of_no_world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "world", "info", str(tmp_path / "none")) == 2
    assert "pavetwin world build" in capsys.readouterr().err

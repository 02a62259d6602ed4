"""`pavetwin world build` and `info` as a user types them."""

import sys
from pathlib import Path

import pytest

from pavetwin.cli import main
from pavetwin.world.network import LeftOut
from pavetwin.world.store import load_record
from scenes import scene_file
from scenes.command_line import without_progress


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run one command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["pavetwin", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_build_and_info_print_the_contents_of_a_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target = str(tmp_path / "cross")
    assert run(monkeypatch, "world", "build", str(scene_file("cross")), "-o", target, "--defects-per-segment", "4") == 0
    printed = capsys.readouterr().out
    for word in ("segments", "lanes", "sidewalks", "1 traffic lights", "5 from the source", "by rule", "defects"):
        assert word in printed
    assert load_record(Path(target)).defects["population"] == "survey"
    assert run(monkeypatch, "world", "info", target) == 0
    assert "14 (" in capsys.readouterr().out


def test_streets_that_are_not_connected_are_listed_as_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    island = """
      <node id="901" version="1" lat="52.0100" lon="13.0100"/>
      <node id="902" version="1" lat="52.0110" lon="13.0100"/>
      <node id="903" version="1" lat="52.0120" lon="13.0100"/>
      <node id="911" version="1" lat="52.0200" lon="13.0100"/>
      <node id="912" version="1" lat="52.0209" lon="13.0100"/>
      <way id="991" version="1"><nd ref="901"/><nd ref="902"/><tag k="highway" v="residential"/>
        <tag k="name" v="Far Lane"/></way>
      <way id="992" version="1"><nd ref="902"/><nd ref="903"/><tag k="highway" v="residential"/>
        <tag k="name" v="Far Lane"/></way>
      <way id="993" version="1"><nd ref="911"/><nd ref="912"/><tag k="highway" v="residential"/></way>
    """
    text = "".join(line for line in scene_file("cross").open(encoding="utf-8") if "Insel" not in line)
    (tmp_path / "whole.osm").write_text(text, encoding="utf-8")
    (tmp_path / "islands.osm").write_text(text.replace("</osm>", island + "</osm>"), encoding="utf-8")
    for name in ("whole", "islands"):
        assert (
            run(
                monkeypatch,
                "world",
                "build",
                str(tmp_path / f"{name}.osm"),
                "-o",
                str(tmp_path / name),
                "--defects-per-segment",
                "1",
            )
            == 0
        )
        assert ("left out" in capsys.readouterr().out) == (name == "islands")
    assert load_record(tmp_path / "whole").left_out == LeftOut()
    lost = load_record(tmp_path / "islands").left_out
    assert lost.streets == 2
    # A degree of latitude there is 111.26 km long on the ellipsoid.
    assert lost.length_m == pytest.approx(0.0029 * 111_260, rel=2e-3)
    assert run(monkeypatch, "world", "info", str(tmp_path / "islands")) == 0
    assert "2 streets" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.osm", "-o", "x"], "does not exist"),
        (["-o", "x"], "either a SOURCE file or --generate"),
        (["--generate", "town"], "Missing option '--output'"),
        (["--generate", "toun", "-o", "x"], "did you mean 'town'"),
        (["--generate", "town", "-o", "x", "--anchor", "100,0"], "not a place"),
        (["--generate", "town", "-o", "x", "--seed", "-1"], "seed"),
        (["--generate", "town", "-o", "x", "--segment-length", "5"], "--segment-length"),
        (["--generate", "grid", "-o", "x", "--defects-per-segment", "-2"], "--defects-per-segment"),
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
    (line,) = without_progress(captured.err)
    assert line.startswith("Error: ")
    assert message in line
    assert list(tmp_path.iterdir()) == []


def test_an_internal_error_is_one_line_that_asks_for_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_folder: Path) -> None:
        raise KeyError("nobody thought of this")

    monkeypatch.delenv("PAVETWIN_DEBUG", raising=False)
    monkeypatch.setattr("pavetwin.cli.options.check_world", broken)
    assert run(monkeypatch, "world", "info", "anywhere") == 1
    words = capsys.readouterr().err
    assert words.count("\n") == 1
    assert "Unexpected failure: KeyError: 'nobody thought of this'. Please report it" in words
    monkeypatch.setenv("PAVETWIN_DEBUG", "1")
    monkeypatch.setattr(sys, "argv", ["pavetwin", "world", "info", "anywhere"])
    with pytest.raises(KeyError):
        main()


def test_info_refuses_a_folder_without_a_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "world", "info", str(tmp_path / "none")) == 2
    assert "pavetwin world build" in capsys.readouterr().err

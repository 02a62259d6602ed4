"""`pavetwin doctor` finds what is missing by looking for it, not by what was noted of it."""

from pathlib import Path

import pytest
import typer

from pavetwin.cli import doctor
from pavetwin.errors import PaveTwinError
from pavetwin.render import adapter


@pytest.mark.needs_adapter
def test_a_complete_installation_passes(capsys: pytest.CaptureFixture[str]) -> None:
    doctor.doctor()
    printed = capsys.readouterr().out
    assert "Nothing is missing." in printed
    assert printed.count("✓") == 6
    assert "Vulkan adapter for frames" in printed


@pytest.mark.parametrize("package", ["libsumo", "pyogrio"])
def test_a_missing_package_is_named_with_the_command_that_installs_it(
    package: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == package else object())
    with pytest.raises(typer.Exit) as ended:
        doctor.doctor()
    assert ended.value.exit_code == 1
    assert f"pip install --force-reinstall {package}" in capsys.readouterr().out


def test_without_an_adapter_it_names_the_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def none() -> None:
        raise PaveTwinError(adapter.NEEDED)

    monkeypatch.setattr(adapter, "find_adapter", none)
    with pytest.raises(typer.Exit):
        doctor.doctor()
    printed = capsys.readouterr().out
    assert "fix: sudo apt-get install mesa-vulkan-drivers" in " ".join(printed.split())


def test_the_cache_is_shown_and_cleared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))
    monkeypatch.setattr(doctor, "_adapter", lambda: doctor.Check("adapter", "there"))
    kept = tmp_path / "worlds" / "abc" / "traffic" / "high-1.parquet"
    kept.parent.mkdir(parents=True)
    kept.write_bytes(bytes(2_000_000))
    tile = tmp_path / "tiles" / "abc" / "0_0" / "maps"
    tile.parent.mkdir(parents=True)
    tile.write_bytes(bytes(300_000))
    placed = tmp_path / "defects" / "abc"
    placed.parent.mkdir()
    placed.write_bytes(bytes(200_000))
    (tmp_path / "thesis.txt").write_text("precious")
    monkeypatch.setenv("PAVETWIN_CACHE_GB", "2.5")
    doctor.doctor()
    assert f"Cache: {tmp_path}, 1 world, 2.5 MB of 2.5 GB at most" in capsys.readouterr().out
    doctor.doctor(clear_cache=True)
    assert f"Cache: {tmp_path}, 0 worlds, 0.0 MB" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]

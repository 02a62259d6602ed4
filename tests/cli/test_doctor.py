"""`pavetwin doctor` finds what is missing by looking for it, not by what was noted of it."""

import pytest
import typer

from pavetwin.cli import doctor
from pavetwin.errors import PaveTwinError
from pavetwin.render import adapter


@pytest.mark.needs_adapter
def test_all_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    doctor.doctor()
    said = capsys.readouterr().out
    assert "Nothing is missing." in said
    assert said.count("✓") == 6
    assert "Vulkan adapter for frames" in said


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
    said = capsys.readouterr().out
    assert "fix: sudo apt-get install mesa-vulkan-drivers" in " ".join(said.split())

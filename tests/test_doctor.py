"""`pavetwin doctor` finds what is missing by looking for it, not by what was noted of it."""

import pytest
import typer

from pavetwin.cli import doctor


def test_all_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    doctor.doctor()
    said = capsys.readouterr().out
    assert "All is there." in said
    assert said.count("✓") == 5


@pytest.mark.parametrize("package", ["libsumo", "pyogrio"])
def test_a_missing_package_is_named_with_the_command_that_mends_it(
    package: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == package else object())
    with pytest.raises(typer.Exit) as ended:
        doctor.doctor()
    assert ended.value.exit_code == 1
    assert f"pip install --force-reinstall {package}" in capsys.readouterr().out

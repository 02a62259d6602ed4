"""Registries: names that are taken, unknown, found in the home package, and given by installed packages."""

import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from textwrap import dedent

import pytest

from pavetwin import registry
from pavetwin.errors import PaveTwinError
from pavetwin.registry import DuplicateNameError, Registry, reading

Sound = Callable[[], str]


@pytest.fixture
def sounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry[Sound]]:
    """A registry whose home is a package of two modules, `bell.py` and `horn.py`."""
    home = tmp_path / "sounds_for_the_test"
    home.mkdir()
    (home / "__init__.py").write_text("")
    sounds: Registry[Sound] = Registry("sound", key="warning.sound", group="test.sounds", home=home.name)
    monkeypatch.setattr(sys, "SOUNDS_OF_THE_TEST", sounds, raising=False)
    for name in ("bell", "horn"):
        add_file(home / f"{name}.py", name)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield sounds
    for module in [module for module in sys.modules if module.startswith(home.name)]:
        del sys.modules[module]


def add_file(path: Path, name: str) -> None:
    text = f"""
        import sys

        @sys.SOUNDS_OF_THE_TEST.register({name!r})
        def make():
            return {name!r}
    """
    path.write_text(dedent(text))


def test_a_new_file_in_the_home_is_all_there_is_to_add(sounds: Registry[Sound], tmp_path: Path) -> None:
    add_file(tmp_path / "sounds_for_the_test" / "siren.py", "siren")
    assert sounds.names() == ["bell", "horn", "siren"]
    assert sounds.get("siren")() == "siren"


def test_what_ships_is_nobodys_own_and_keeps_its_order_where_a_users_file_imports_it_first(
    sounds: Registry[Sound], tmp_path: Path
) -> None:
    package = "sounds_for_the_test"
    (tmp_path / package / "__init__.py").write_text(f"from {package} import horn\nfrom {package} import bell\n")
    with reading("'mine.py'") as source:
        import_module(package)
        sounds.add("whistle", lambda: "whistle")
    assert sounds.names() == ["horn", "bell", "whistle"]
    assert [name for _, name, _ in source.added] == ["whistle"]
    assert sounds.is_own("horn")
    assert not sounds.is_own("whistle")


def test_an_unknown_name_is_answered_with_the_nearest_and_all(sounds: Registry[Sound]) -> None:
    with pytest.raises(PaveTwinError) as caught:
        sounds.get("bel")
    assert str(caught.value).startswith("warning.sound: no sound 'bel' (did you mean 'bell'?); known are bell, horn.")


def test_a_name_is_taken_once_also_before_it_was_asked_for(sounds: Registry[Sound]) -> None:
    with pytest.raises(DuplicateNameError, match="a sound 'horn' is registered already"):
        sounds.add("horn", lambda: "another")
    assert sounds.get("horn")() == "horn"


def test_what_is_read_again_may_take_its_name_again(sounds: Registry[Sound]) -> None:
    def gong() -> str:
        return "gong"

    for _ in range(2):
        with reading("'gong.py'"):
            sounds.add("gong", gong)
    with pytest.raises(DuplicateNameError, match=r"registered already, by 'gong\.py'"), reading("'other.py'"):
        sounds.add("gong", lambda: "another")
    with reading("'gong.py'"):
        sounds.add("gong", gong)
        with pytest.raises(DuplicateNameError):
            sounds.add("gong", gong)
    assert sounds.get("gong") is gong


def test_what_a_failed_file_registered_is_taken_back(sounds: Registry[Sound]) -> None:
    def fails() -> None:
        with reading("'broken.py'"):
            sounds.add("gong", lambda: "gong")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert sounds.names() == ["bell", "horn"]


def installed(monkeypatch: pytest.MonkeyPatch, *points: tuple[str, str]) -> None:
    found = [EntryPoint(name, value, "test.sounds") for name, value in points]
    monkeypatch.setattr(registry, "entry_points", lambda *, group: [it for it in found if it.group == group])


def test_installed_packages_add_by_entry_points(
    sounds: Registry[Sound], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module that registers, or the thing itself."""
    package = tmp_path / "sounds_for_the_test_too"
    package.mkdir()
    add_file(package / "whistle.py", "whistle")
    (package / "plain.py").write_text("def drum():\n    return 'drum'\n")
    installed(monkeypatch, ("whistle", f"{package.name}.whistle"), ("drum", f"{package.name}.plain:drum"))
    assert sounds.get("drum")() == "drum"
    assert sounds.names() == ["bell", "horn", "whistle", "drum"]


def test_a_broken_package_is_named_in_one_line(sounds: Registry[Sound], monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, ("drum", "no_such_package_here:drum"))
    assert sounds.get("bell")() == "bell", "what is known needs no package"
    with pytest.raises(PaveTwinError, match="'no_such_package_here:drum' cannot give its sound 'drum': ModuleNotFound"):
        sounds.names()

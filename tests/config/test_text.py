"""Settings files as text: the same by libyaml and by PyYAML, and mistakes with their line."""

from importlib.resources import files
from pathlib import Path

import pytest
import yaml

from pavetwin.config import text
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError

SHIPPED = sorted(Path(str(files("pavetwin"))).rglob("*.yaml"))


def test_every_shipped_file_reads_the_same_without_libyaml(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = [parse_yaml(path.read_text(encoding="utf-8"), path.name) for path in SHIPPED]
    monkeypatch.setattr(text, "_QuickLoader", text._Loader)
    assert len(quick) > 20
    assert quick == [parse_yaml(path.read_text(encoding="utf-8"), path.name) for path in SHIPPED]


def test_a_time_of_day_is_text_and_a_number_a_number() -> None:
    assert parse_yaml("{a: 10:30, b: 1030, c: 2.5, d: yes}", "it") == {"a": "10:30", "b": 1030, "c": 2.5, "d": True}
    assert parse_yaml("", "it") is None


@pytest.mark.parametrize("document", ["a: 1\nb:\n  - {c: 1, c: 2}\n", "a: &x {c: 1, c: 1}\nb: [*x, *x]\n"])
def test_a_key_given_twice_deep_inside_is_refused(document: str) -> None:
    with pytest.raises(PaveTwinError, match=r"^it, line \d: 'c' is given twice\.$"):
        parse_yaml(document, "it")


def test_a_list_that_holds_itself_ends() -> None:
    found = parse_yaml("&x [*x, 1]", "it")
    assert found[0] is found
    assert found[1] == 1


def test_a_mistake_has_the_message_of_pyyaml() -> None:
    with pytest.raises(yaml.MarkedYAMLError) as raised:
        parse_yaml("a: [1, 2\nb: 3\n", "it")
    assert raised.value.context == "while parsing a flow sequence"

"""The aircraft that ship with the package: an entry of `aircraft.yaml` each."""

from importlib.resources import files

from pavetwin.uav.aircraft import AIRCRAFT, parse_aircraft

_TEXT = (files("pavetwin.uav") / "aircraft.yaml").read_text(encoding="utf-8")

for _name, _profile in parse_aircraft(_TEXT, "aircraft.yaml").items():
    AIRCRAFT.add(_name, _profile)

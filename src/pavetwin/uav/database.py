"""Registration of the aircraft and cameras that ship with PaveTwin, from aircraft.yaml and cameras.yaml."""

from importlib.resources import files

from pavetwin.uav.aircraft import AIRCRAFT, parse_aircraft
from pavetwin.uav.cameras import CAMERAS, parse_cameras

_AIRCRAFT = (files("pavetwin.uav") / "aircraft.yaml").read_text(encoding="utf-8")

for _name, _profile in parse_aircraft(_AIRCRAFT, "aircraft.yaml").items():
    AIRCRAFT.add(_name, _profile)


_CAMERAS = (files("pavetwin.uav") / "cameras.yaml").read_text(encoding="utf-8")

for _camera_name, _camera in parse_cameras(_CAMERAS, "cameras.yaml").items():
    CAMERAS.add(_camera_name, _camera)

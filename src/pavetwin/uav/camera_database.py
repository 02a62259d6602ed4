"""The cameras that ship with the package: an entry of `cameras.yaml` each."""

from importlib.resources import files

from pavetwin.uav.cameras import CAMERAS, parse_cameras

_TEXT = (files("pavetwin.uav") / "cameras.yaml").read_text(encoding="utf-8")

for _name, _camera in parse_cameras(_TEXT, "cameras.yaml").items():
    CAMERAS.add(_name, _camera)

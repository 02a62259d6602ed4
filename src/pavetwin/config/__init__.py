"""Typed configuration and presets."""

from pavetwin.config.base import Settings
from pavetwin.config.mission import MissionSettings, load_settings, preset_names

__all__ = ["MissionSettings", "Settings", "load_settings", "preset_names"]

"""Typed configuration and presets."""

from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import MissionSettings, load_settings, preset_names
from pavetwin.config.settings import Settings

__all__ = ["Conditions", "MissionSettings", "Settings", "load_settings", "preset_names"]

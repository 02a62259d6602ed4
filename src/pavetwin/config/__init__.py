"""Typed configuration and presets."""

from pavetwin.config.base import Settings
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import MissionSettings, load_settings, preset_names

__all__ = ["Conditions", "MissionSettings", "Settings", "load_settings", "preset_names"]

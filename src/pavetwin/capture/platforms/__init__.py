"""What carries the camera. One file a platform, one registry."""

from pavetwin.capture.platforms.base import Platform, Pose, Setting, find_platform, platform
from pavetwin.capture.platforms.car import Car
from pavetwin.capture.platforms.uav import Uav

__all__ = ["Car", "Platform", "Pose", "Setting", "Uav", "find_platform", "platform"]

"""What carries the camera. One file a platform, one registry."""

from pavetwin.capture.platforms.base import PLATFORMS, Platform, Pose, Setting, platform

__all__ = ["PLATFORMS", "Platform", "Pose", "Setting", "platform"]

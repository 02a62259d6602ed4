"""What carries the camera. One file per platform, one registry."""

from pavetwin.capture.platforms.platform import PLATFORMS, CaptureContext, Platform, Pose, flying, platform

__all__ = ["PLATFORMS", "CaptureContext", "Platform", "Pose", "flying", "platform"]

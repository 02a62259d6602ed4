"""Platforms that carry the camera: one file each, one registry."""

from pavetwin.capture.platforms.platform import PLATFORMS, CaptureContext, Platform, Pose, flying, platform

__all__ = ["PLATFORMS", "CaptureContext", "Platform", "Pose", "flying", "platform"]

"""What can go wrong with a device.

DeviceError            the device as asked for cannot be used; the sentence says who, expected, found, what to do
├── DeviceUnavailable  it does not answer: no driver, no server, nothing plugged in, refused
├── DeviceMisconfigured  it answers and refuses what was asked: rate, channel, range, label
└── DeviceLost         it answered before and does so no more
"""

from __future__ import annotations


class DeviceError(Exception):
    """One sentence for the operator; a second may say what to do."""

    exit_code = 1


class DeviceUnavailable(DeviceError):
    """Nothing answers where the configuration points."""


class DeviceMisconfigured(DeviceError):
    """It answers, and cannot do what the configuration asks."""


class DeviceLost(DeviceError):
    """It was there, and is gone or silent."""

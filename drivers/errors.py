"""Errors of a device.

DeviceError            the device cannot be used as configured; the sentence names device, expected, found, remedy
├── DeviceUnavailable  no answer: no driver, no server, not plugged in, connection refused
├── DeviceMisconfigured  it rejects the configuration: rate, channel, range, label
└── DeviceLost         it answered before and no longer does
"""

from __future__ import annotations


class DeviceError(Exception):
    """One sentence for the operator; a second may say what to do."""

    exit_code = 1


class DeviceUnavailable(DeviceError):
    """No device answers at the configured address."""


class DeviceMisconfigured(DeviceError):
    """The device answers and rejects the configuration."""


class DeviceLost(DeviceError):
    """The device was connected and is gone or silent."""

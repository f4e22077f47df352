"""Errors of a device.

DeviceError            the device cannot be used as configured; the sentence names device, expected, found, remedy
├── DeviceUnavailable  no answer: no driver, no server, not plugged in, connection refused
├── DeviceMisconfigured  it rejects the configuration: rate, channel, range, label
└── DeviceLost         it answered before and no longer does
"""

from __future__ import annotations

from enum import StrEnum


class DeviceCode(StrEnum):
    """Stable codes of errors, for programs. The code of a class stands for any reason that has no code of its own."""

    FAILED = "device_failed"

    UNAVAILABLE = "device_unavailable"
    NO_DRIVER = "device_unavailable.driver_not_installed"
    NOT_FOUND = "device_unavailable.not_found"
    IN_USE = "device_unavailable.in_use"
    NOT_LOCKED = "device_unavailable.not_locked"
    NO_SERVER = "device_unavailable.no_server"
    NO_ANSWER = "device_unavailable.no_answer"
    NETWORK_TOO_SLOW = "device_unavailable.network_too_slow"
    NO_TRANSFER = "device_unavailable.no_transfer"
    CAPTURE_NOT_OURS = "device_unavailable.capture_not_ours"

    MISCONFIGURED = "device_misconfigured"
    UNKNOWN_DRIVER = "device_misconfigured.unknown_driver"
    REFUSED = "device_misconfigured.refused"
    NO_CHANNEL = "device_misconfigured.no_channel"
    NO_MARKER = "device_misconfigured.no_marker"
    UNUSABLE_SETTINGS = "device_misconfigured.unusable_settings"
    SEVERAL_OUTLETS = "device_misconfigured.several_outlets"
    NO_SIGNAL = "device_misconfigured.no_signal"
    MIXED_UNITS = "device_misconfigured.mixed_units"
    CHANGED = "device_misconfigured.changed"

    LOST = "device_lost"
    CLOSED = "device_lost.closed"
    DISCONNECTED = "device_lost.disconnected"
    SILENT = "device_lost.silent"
    UNREADABLE = "device_lost.unreadable"
    NOT_RECONNECTED = "device_lost.not_reconnected"


class DeviceError(Exception):
    """One sentence for the operator, a second may say what to do; code is for programs."""

    exit_code = 1
    general_code = DeviceCode.FAILED

    def __init__(self, sentence: str, code: StrEnum | None = None) -> None:
        super().__init__(sentence)
        self.code: StrEnum = code or self.general_code


class DeviceUnavailable(DeviceError):
    """No device answers at the configured address."""

    general_code = DeviceCode.UNAVAILABLE


class DeviceMisconfigured(DeviceError):
    """The device answers and rejects the configuration."""

    general_code = DeviceCode.MISCONFIGURED


class DeviceLost(DeviceError):
    """The device was connected and is gone or silent."""

    general_code = DeviceCode.LOST


def one_line(error: Exception) -> str:
    """Text of another package's error on one line, or the name of its type."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__

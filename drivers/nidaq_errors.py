"""Errors of NI-DAQmx, of its gRPC server and of the transport, as sentences for the operator."""

from __future__ import annotations

import re

from drivers.errors import DeviceCode, DeviceError, DeviceLost, DeviceMisconfigured, DeviceUnavailable

# nidaqmx.error_codes.DAQmxErrors
TIMED_OUT = -200284
OVERRUN = {-200279, -200222, -200361, -200004}  # PC buffer or on-board FIFO overwritten: a restart cures it
NO_SUCH_DEVICE = {-200220, -201003, -200045}
IN_USE = {-200022, -50103}
NO_SUCH_CHANNEL = {-200170}
NO_TRANSFER = {-50405}  # of the USB-600x, after minutes or hours; only unplugging it helps

UNAVAILABLE = (
    (NO_SUCH_DEVICE, DeviceCode.NOT_FOUND, "was not found", "plug it in, or correct daq.device"),
    (
        IN_USE,
        DeviceCode.IN_USE,
        "is in use by another program",
        "close that program; if none is running, restart NI's device server to clear the task of a program that died",
    ),
    (NO_TRANSFER, DeviceCode.NO_TRANSFER, "transfers no samples", "unplug it and plug it in again"),
)
"""NI's error codes → our code, what happened, what to do."""


def code_of(error: BaseException | None) -> int:
    """NI's error code; 0 for errors of the transport."""
    return int(getattr(error, "error_code", 0))


def refusal_of(error: Exception, device: str, where: str, asked: str) -> DeviceError:
    """The error at opening; asked names the inputs with their ranges, the rate and the start that were asked for."""
    from nidaqmx.errors import DaqNotFoundError

    code, who = code_of(error), f"{device} at {where}"
    if isinstance(error, DaqNotFoundError):
        return DeviceUnavailable(
            f"{device} needs the NI-DAQmx driver, and this computer has none; "
            "install it, or set daq.grpc_target to an NI gRPC device server",
            DeviceCode.NO_DRIVER,
        )
    for codes, reason, what, advice in UNAVAILABLE:
        if code in codes:
            return DeviceUnavailable(f"{who} {what} (NI error {code}); {advice}", reason)
    if code in NO_SUCH_CHANNEL:
        return DeviceMisconfigured(
            f"{who} was asked for the differential inputs {asked} and lacks one of them (NI error {code}); "
            "correct daq.force_channel, daq.sync_channel or the inputs of [emg] and [analog]",
            DeviceCode.NO_CHANNEL,
        )
    if code < 0:
        return DeviceMisconfigured(
            f"{who} was asked for {asked}, and refused: {_text_of(error)} (NI error {code}); correct the [daq] section",
            DeviceCode.REFUSED,
        )
    sentence = f"{who}: expected an answer of NI-DAQmx, found {_text_of(error)}; restart its server"
    return DeviceUnavailable(sentence, DeviceCode.NO_ANSWER)


def loss_of(error: Exception, who: str) -> DeviceLost:
    """The error of a device that was streaming."""
    code = code_of(error)
    advice = "unplug it and plug it in again" if code in NO_TRANSFER else "check its cable and its server"
    shown = f" (NI error {code})" if code else ""
    return DeviceLost(f"{who} stopped streaming: {_text_of(error)}{shown}; {advice}", DeviceCode.DISCONNECTED)


def _text_of(error: Exception) -> str:
    """Error text of NI or gRPC on one line, without code and task name."""
    is_grpc = callable(getattr(error, "details", None))  # an error of gRPC itself, which nidaqmx passes on
    text = f"{error.code().name}: {error.details()}" if is_grpc else str(error)  # type: ignore[attr-defined]
    text = re.split(r"\n\s*(?:Task Name|Status Code):", text)[0].removeprefix("StatusCode.")
    if text.startswith("DEADLINE_EXCEEDED"):
        return "no answer in time"
    return " ".join(text.split()).rstrip(".")[:300] or type(error).__name__

"""QTM's settings: labels, frame rate, and the cameras that identify it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from xml.etree import ElementTree


@dataclass(frozen=True)
class CameraSystem:
    """Identity of a camera system: the serial numbers of its cameras, and the time of their calibration.

    Neither changes while a capture runs, but a camera may fail.
    """

    serials: frozenset[str]
    calibrated: str

    def __str__(self) -> str:
        cameras = f"cameras {', '.join(sorted(self.serials))}" if self.serials else "cameras without serial numbers"
        return f"{cameras}, calibrated {self.calibrated or 'at an unknown time'}"

    def contradicts(self, other: CameraSystem) -> bool:
        """Whether the two cannot be one system; what a QTM does not report contradicts nothing."""
        has_other_cameras = bool(self.serials and other.serials) and not self.serials & other.serials
        has_other_calibration = bool(self.calibrated and other.calibrated) and self.calibrated != other.calibrated
        return has_other_cameras or has_other_calibration


@dataclass(frozen=True)
class Parameters:
    """QTM's settings "general" and "3d": labels in the order of the frames, frame rate, cameras."""

    labels: tuple[str, ...]
    rate_hz: float
    cameras: CameraSystem


def decode_parameters(xml: bytes) -> Parameters:
    """Raises ValueError where the XML has no label or no frame rate."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314  (expat bounds what entities grow to)
    except ElementTree.ParseError as error:
        raise ValueError(f"settings that are not XML ({error})") from error
    labels = tuple(node.text or "" for node in root.findall("The_3D/Label/Name"))
    rate = root.findtext("General/Frequency")
    if not labels or rate is None:
        raise ValueError("settings without a capture frequency" if labels else "settings without labels")
    rate_hz = float(rate)
    if not 0 < rate_hz < inf:
        raise ValueError(f"settings with a capture frequency of {rate!r}")
    serials = frozenset(node.text.strip() for node in root.findall("General/Camera/Serial") if node.text)
    return Parameters(labels, rate_hz, CameraSystem(serials, (root.findtext("The_3D/CalibrationTime") or "").strip()))

"""The part of pylsl that the driver uses, over outlets of a test's own, without a network."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


class _Description:
    def child(self, _name: str) -> _Description:
        return self

    def child_value(self, _name: str) -> str:
        return ""


@dataclass
class FakeOutlet:
    """chunks are (values, stamps) that its inlet hands out one by one; a RuntimeError among them is raised."""

    labels: list[str] | None = field(default_factory=lambda: ["a", "b"])
    units: list[str] | None = field(default_factory=lambda: ["microvolts", "microvolts"])
    rate_hz: float = 1000.0
    channels: int = 2
    is_text: bool = False
    chunks: list[tuple[np.ndarray, np.ndarray] | RuntimeError] = field(default_factory=list)
    id: str = "one"

    def send(self, first_s: float, count: int) -> None:
        stamps = first_s + np.arange(count) / self.rate_hz
        self.chunks.append((np.zeros((count, self.channels), np.float32), stamps))

    def info(self, _timeout_s: float) -> FakeOutlet:
        return self

    def uid(self) -> str:
        return self.id

    def hostname(self) -> str:
        return f"pc-{self.id}"

    def source_id(self) -> str:
        return ""

    def type(self) -> str:
        return "EMG"

    def nominal_srate(self) -> float:
        return self.rate_hz

    def channel_count(self) -> int:
        return self.channels

    def channel_format(self) -> int:
        return FakeLsl.cf_string if self.is_text else 1

    def get_channel_labels(self) -> list[str] | None:
        return self.labels

    def get_channel_units(self) -> list[str] | None:
        return self.units

    def desc(self) -> _Description:
        return _Description()


class FakeLsl:
    """Stands for the module; all its outlets have the name that is asked for."""

    cf_string, proc_none = 3, 0

    def __init__(self, *outlets: FakeOutlet) -> None:
        self.outlets = list(outlets)

    def resolve_byprop(self, _property: str, _name: str, _minimum: int, _timeout_s: float) -> list[FakeOutlet]:
        return self.outlets

    def local_clock(self) -> float:
        return 50.0

    def StreamInlet(self, outlet: FakeOutlet, *, recover: bool, processing_flags: int) -> _FakeInlet:  # noqa: N802
        assert not recover and processing_flags == self.proc_none, "the driver itself reconnects, and keeps the stamps"
        return _FakeInlet(outlet)


class _FakeInlet:
    def __init__(self, outlet: FakeOutlet) -> None:
        self._outlet = outlet
        self.info = outlet.info

    def open_stream(self, _timeout_s: float) -> None: ...

    def close_stream(self) -> None: ...

    def time_correction(self, _timeout_s: float) -> float:
        return 0.0

    def pull_chunk(self, _timeout_s: float, _most: int, *, as_numpy: bool) -> tuple[np.ndarray, np.ndarray]:
        assert as_numpy
        if not self._outlet.chunks:
            return np.zeros((0, self._outlet.channels), np.float32), np.zeros(0)
        chunk = self._outlet.chunks.pop(0)
        if isinstance(chunk, RuntimeError):
            raise chunk
        return chunk

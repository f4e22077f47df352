"""What an operator must know of the live values: findings that last a second, so that they can be read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from solver.stream.stream_frame import StreamNotice, StreamOutcome, StreamSuitOutcome
from station.live.published import LiveFinding, LiveValues
from station.messages.live_codes import LiveCode
from station.messages.message import Message

SHOWN_S = 1.0
LEFT_S = 0.5
"""Without any marker, until the wearer counts as outside the volume."""
LEAST_UNSOLVED = 0.1
"""Of the frames of the last second."""
UNSOLVED = (StreamOutcome.NOT_CONVERGED, StreamOutcome.GAP_OPEN)
UNSOLVED_MUSCLES = (
    StreamSuitOutcome.INFEASIBLE,
    StreamSuitOutcome.NOT_CONVERGED,
    StreamSuitOutcome.NOT_FINITE,
    StreamSuitOutcome.CUFF_NOT_AT_REST,
)


class LiveFindings:
    """Findings on the values of the last second, in the cameras' time."""

    def __init__(self, markers: int, lasting: Iterable[Message[LiveCode]] = ()) -> None:
        """lasting: findings on body and suit, which hold for the whole trial."""
        self._markers, self._lasting = markers, tuple(lasting)
        self._last: dict[LiveCode, tuple[float, Message[LiveCode]]] = {}
        self._frames: list[tuple[float, tuple[str, ...]]] = []
        self._seen_s: float | None = None
        self._now_s = 0.0

    def add(self, values: LiveValues) -> None:
        now = self._now_s = values.time_s
        if len(values.hidden) < self._markers or self._seen_s is None:
            self._seen_s = now
        if values.exchanged:
            pairs = ", ".join(" and ".join(pair) for pair in values.exchanged)
            self._note(Message(LiveCode.MARKERS_EXCHANGED, {"markers": pairs}))
        if values.left_out:
            self._note(Message(LiveCode.MARKERS_LEFT_OUT, {"markers": ", ".join(values.left_out)}))
        if values.lost:
            self._note(Message(LiveCode.NOT_HELD, {"coordinates": ", ".join(values.lost)}))
        failures = [values.outcome] if values.outcome in UNSOLVED else []
        failures += sorted({one.outcome for one in values.scenarios if one.outcome in UNSOLVED_MUSCLES})
        self._frames = [frame for frame in self._frames if frame[0] > now - SHOWN_S]
        self._frames.append((now, tuple(failures)))

    def shown(self) -> tuple[LiveFinding, ...]:
        """The findings that hold now."""
        away_s = 0.0 if self._seen_s is None else self._now_s - self._seen_s
        if away_s >= LEFT_S:
            left = Message(LiveCode.WEARER_LEFT, {"seconds": away_s})
            return plain_findings([*self._lasting, left])
        current = [message for time_s, message in self._last.values() if time_s > self._now_s - SHOWN_S]
        return plain_findings([*self._lasting, *current, *self._unsolved()])

    def _note(self, message: Message[LiveCode]) -> None:
        self._last[message.code] = self._now_s, message

    def _unsolved(self) -> list[Message[LiveCode]]:
        counts = Counter(failure for _, failures in self._frames for failure in failures)
        return [
            Message(LiveCode.UNSOLVED, {"frames": float(count), "of": float(len(self._frames)), "outcome": outcome})
            for outcome, count in counts.items()
            if count >= LEAST_UNSOLVED * len(self._frames)
        ]


def notice_messages(model: str, notices: Iterable[StreamNotice]) -> list[Message[LiveCode]]:
    codes = {StreamNotice.NO_GLENOID_CONE: LiveCode.NO_GLENOID, StreamNotice.NO_GLENOHUMERAL_JOINT: LiveCode.NO_JOINT}
    return [Message(codes[notice], {"model": model}) for notice in sorted(notices)]


def plain_findings(messages: Iterable[Message[LiveCode]]) -> tuple[LiveFinding, ...]:
    return tuple(LiveFinding(message.code.value, str(message)) for message in messages)

"""Errors of the transport as sentences."""

from __future__ import annotations

import grpc

from drivers.errors import DeviceCode
from drivers.nidaq_errors import refusal_of
from tests.drivers.contract import is_one_sentence


class FrozenCall(grpc.RpcError):
    """As grpc raises it when a server that was reached does not answer a call."""

    def code(self) -> grpc.StatusCode:
        return grpc.StatusCode.DEADLINE_EXCEEDED

    def details(self) -> str:
        return "Deadline Exceeded"

    def __str__(self) -> str:
        return "<_InactiveRpcError of RPC that terminated with:\n\tstatus = StatusCode.DEADLINE_EXCEEDED\n>"


def test_a_call_without_an_answer_is_a_sentence_and_no_dump_of_the_transport() -> None:
    error = refusal_of(FrozenCall(), "NI Dev1", "127.0.0.1:1", "ai0")
    assert error.code is DeviceCode.NO_ANSWER
    assert "StatusCode" not in str(error)
    assert is_one_sentence(error)

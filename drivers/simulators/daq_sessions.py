"""The sessions of an NI gRPC Device Server: a task lives until it is cleared, also if its client dies.

As in ni/grpc-device, source/server/session_repository.cpp: a session has no time-out and outlives its connection.
"""

from __future__ import annotations

import grpc
from session_pb2 import SessionInitializationBehavior as Behavior

from drivers.errors import DeviceError
from drivers.simulators.acquisition_task import AcquisitionTask
from drivers.simulators.usb6008 import DaqmxError, Usb6008

NO_SUCH_TASK = (-200088, "Task specified is invalid or does not exist.")


class SessionRefused(DeviceError):
    """The client expected a session that does not exist, or a new one that exists; not an error of NI-DAQmx."""

    def __init__(self, status: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.status = status


class DaqSessions:
    """The tasks of one server, by the names of their sessions."""

    def __init__(self, device: Usb6008) -> None:
        self._device = device
        self._tasks: dict[str, AcquisitionTask] = {}
        self._unnamed = 0

    def create(self, name: str, behavior: int) -> tuple[AcquisitionTask, bool]:
        """The task of this name, and whether it is new. An empty name makes a new one. Raises SessionRefused."""
        if not name:
            name, self._unnamed = f"_unnamedTask<{self._unnamed}>", self._unnamed + 1
        task = self._tasks.get(name)
        if task is not None and behavior == Behavior.SESSION_INITIALIZATION_BEHAVIOR_INITIALIZE_NEW:
            text = f"Cannot initialize '{name}' when a session already exists."
            raise SessionRefused(grpc.StatusCode.ALREADY_EXISTS, text)
        if task is None and behavior == Behavior.SESSION_INITIALIZATION_BEHAVIOR_ATTACH_TO_EXISTING:
            text = f"Cannot attach to '{name}' because a session has not been initialized."
            raise SessionRefused(grpc.StatusCode.FAILED_PRECONDITION, text)
        if task is not None:
            return task, False
        self._tasks[name] = task = AcquisitionTask(self._device, name)
        return task, True

    def find(self, name: str, *, must_live: bool = True) -> AcquisitionTask:
        """The task of a session. Raises DaqmxError if there is none or, with must_live, if its device was removed."""
        if name not in self._tasks:
            raise DaqmxError(*NO_SUCH_TASK)
        if must_live:
            self._tasks[name].ensure_alive()
        return self._tasks[name]

    def holds(self, task: AcquisitionTask) -> bool:
        """Whether the task has not been cleared."""
        return self._tasks.get(task.name) is task

    def clear(self, name: str) -> None:
        """End the task, also if its device is gone. Raises DaqmxError without a task."""
        task = self._tasks.pop(name, None)
        if task is None:
            raise DaqmxError(*NO_SUCH_TASK)
        task.stop()

    def clear_all(self) -> None:
        """End every task, and the calls that wait for one."""
        for name in list(self._tasks):
            self.clear(name)

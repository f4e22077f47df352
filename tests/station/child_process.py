"""End a child process of a test: at once, or with a key of its terminal."""

import os
import signal
import subprocess
import sys
from typing import Any

import psutil

from station.end_signals import end_signals

STOP = end_signals()[-1] if sys.platform == "win32" else signal.SIGTERM
"""Asks a program to end. On Windows Ctrl-Break, because SIGTERM from another process ends a process at once there."""
CONTROL_EVENTS = {"SIGINT": 0, "SIGBREAK": 1}  # of Windows' header consoleapi.h
PROCESS_ALL_ACCESS = 0x1F_FFFF


def end_process(child: subprocess.Popen[Any]) -> None:
    """Kill it if it still runs, and close its pipes."""
    if child.poll() is None:
        child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout, child.stderr):
        if pipe is not None:
            pipe.close()


def press(key: signal.Signals, pid: int) -> None:
    """The signal of a key of the terminal, for this process only. On Windows SIGINT is Ctrl-C, SIGBREAK Ctrl-Break.

    A console of Windows starts this thread in each of its processes. GenerateConsoleCtrlEvent would ask the console for
    it, which Wine 8 does for Ctrl-C only (server/console.c: "should support the other events").
    """
    if sys.platform != "win32":
        os.kill(pid, key)
        return
    import ctypes

    kernel: Any = ctypes.WinDLL("kernel32", use_last_error=True)
    routine = ctypes.cast(ctypes.WinDLL("kernelbase").CtrlRoutine, ctypes.c_void_p)
    kernel.OpenProcess.restype = kernel.CreateRemoteThread.restype = ctypes.c_void_p
    process = ctypes.c_void_p(kernel.OpenProcess(PROCESS_ALL_ACCESS, 0, _program(pid)))
    thread = kernel.CreateRemoteThread(process, None, 0, routine, ctypes.c_void_p(CONTROL_EVENTS[key.name]), 0, None)
    assert thread, ctypes.get_last_error()
    kernel.CloseHandle(ctypes.c_void_p(thread))
    kernel.CloseHandle(process)


def _program(pid: int) -> int:
    """The python.exe of a virtual environment is a parent of the program, with the same arguments."""
    process = psutil.Process(pid)
    arguments = process.cmdline()[1:]
    return next((child.pid for child in process.children() if child.cmdline()[1:] == arguments), pid)

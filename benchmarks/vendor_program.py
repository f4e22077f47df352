"""Run one program unchanged, with its calls to a vendor's package redirected to a simulated device.

    python -m benchmarks.vendor_program nidaqmx|qtm_rt PORT PROGRAM

With nidaqmx, every task and the local system are those of the device server at PORT, by GrpcSessionOptions. With
qtm_rt, every connection goes to PORT.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from typing import Any


def main() -> None:
    package, port, program = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    {"nidaqmx": _redirect_nidaqmx, "qtm_rt": _redirect_qtm_rt}[package](port)
    sys.argv = [program]
    sys.path.insert(0, str(Path(program).parent))
    runpy.run_path(program, run_name="__main__")


def _redirect_nidaqmx(port: int) -> None:
    import grpc
    import nidaqmx
    import nidaqmx.system
    import nidaqmx.task

    channel = grpc.insecure_channel(f"127.0.0.1:{port}", options=[("grpc.enable_http_proxy", 0)])

    class Task(nidaqmx.Task):
        def __init__(self, new_task_name: str = "", *, grpc_options: Any = None) -> None:
            remote = grpc_options or nidaqmx.GrpcSessionOptions(channel, new_task_name)
            super().__init__(new_task_name, grpc_options=remote)

    def local() -> nidaqmx.system.System:
        return nidaqmx.system.System.remote(nidaqmx.GrpcSessionOptions(channel, ""))

    nidaqmx.Task = nidaqmx.task.Task = Task  # type: ignore[misc]
    nidaqmx.system.System.local = staticmethod(local)  # type: ignore[method-assign,assignment]


def _redirect_qtm_rt(port: int) -> None:
    import qtm_rt

    connect = qtm_rt.connect

    async def connect_here(host: str, _port: int = port, **options: Any) -> Any:
        return await connect(host, port, **options)

    qtm_rt.connect = connect_here


if __name__ == "__main__":
    main()

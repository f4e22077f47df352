"""The script that runs the vendors' example programs, on programs of our own: none of theirs is kept here."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.vendor_examples import main, programs

PROGRAMS = {
    "on_demand.py": """
import nidaqmx
with nidaqmx.Task() as task:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    print(f"{task.read():.3f} V")
""",
    "system.py": """
from nidaqmx.system import System
print([device.product_type for device in System.local().devices])
""",
    "counter.py": """
import nidaqmx
with nidaqmx.Task() as task:
    task.ci_channels.add_ci_count_edges_chan("Dev1/ctr0")
""",
    "stream.py": """
import asyncio
import qtm_rt
async def main():
    connection = await qtm_rt.connect("127.0.0.1")
    await connection.stream_frames(components=["3d"], on_packet=lambda packet: print(packet.framenumber, flush=True))
    await asyncio.Event().wait()
asyncio.run(main())
""",
    "no_vendor.py": "print('nothing of a vendor')",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in PROGRAMS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_only_programs_that_import_a_vendor_s_package_are_run(folder: Path) -> None:
    found = {path.name: package for path, package in programs(folder)}
    assert found == {"on_demand.py": "nidaqmx", "system.py": "nidaqmx", "counter.py": "nidaqmx", "stream.py": "qtm_rt"}


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_each_program_s_verdict_and_last_word_is_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(folder)]) == 0
    rows = {line.split()[1]: line for line in capsys.readouterr().out.splitlines()[:-1]}
    assert rows["on_demand.py"].startswith("passed") and rows["on_demand.py"].endswith(" V")
    assert rows["system.py"].startswith("passed") and "USB-6008" in rows["system.py"]
    assert rows["counter.py"].startswith("failed") and "UNIMPLEMENTED" in rows["counter.py"]
    assert rows["stream.py"].startswith("passed") and "(goes on)" in rows["stream.py"]


def test_a_folder_without_programs_is_wrong_usage(tmp_path: Path) -> None:
    assert main([str(tmp_path)]) == 2

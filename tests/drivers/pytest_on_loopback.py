"""Run tests in a network of their own, for what binds to all addresses, such as liblsl."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.drivers.own_loopback import CANNOT
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
CONFIG = """[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
[lab]
KnownPeers = {127.0.0.1}
[log]
level = -3
"""


def passed_on_loopback(file: str, chosen: str, folder: Path) -> int:
    """Run the tests of the file whose names hold `chosen`, in a network of their own, with liblsl confined to it.

    Returns how many passed; a test that fails there fails here with its output.
    """
    if sys.platform != "linux":
        pytest.skip("only Linux gives a test a network of its own")
    (folder / "lsl.cfg").write_text(CONFIG, encoding="ascii")
    network = [sys.executable, "-m", "tests.drivers.own_loopback", "env", f"LSLAPICFG={folder / 'lsl.cfg'}"]
    tests = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider", file, "-k", chosen]
    ran = subprocess.run(  # noqa: S603
        [*network, *tests], cwd=ROOT, capture_output=True, text=True, check=False, timeout=scaled_timeout(120)
    )
    if ran.returncode == CANNOT:
        pytest.skip(f"this computer gives a test no network of its own: {ran.stderr.strip()}")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return int(re.findall(r"(\d+) passed", ran.stdout)[-1])

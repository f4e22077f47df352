"""A wheel with compiled kernels, built from this checkout and installed elsewhere."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.solver.test_compile_ahead import CUFFS
from tests.solver.test_shipped_kernels import has_instructions

ROOT = Path(__file__).parents[2]
MOST_BEYOND_WARM_S = 2.0
USE = """
import sys, time
from pathlib import Path
import cuffstation as cs
import solver
assert Path(solver.__file__).is_relative_to(sys.argv[1]), solver.__file__
model = cs.load_model()
times = []
for _ in range(2):
    began = time.process_time()
    cs.assess(cs.read_cuffs(sys.argv[2]), model, cs.load_motion(model, every=200), people=0)
    times.append(time.process_time() - began)
print(times[0] - times[1])
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@has_instructions
def test_an_installed_wheel_compiles_nothing(tmp_path: Path) -> None:
    wheels, installed, kept = tmp_path / "wheels", tmp_path / "installed", tmp_path / "kept"
    _run("-m", "solver.kernel_wheel", str(wheels))
    (wheel,) = wheels.iterdir()
    assert f"-cp{sys.version_info.major}{sys.version_info.minor}-none-" in wheel.name
    _run("-m", "pip", "install", "--no-deps", "--target", str(installed), str(wheel))
    environment = {"PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(kept)}
    cuffs = tmp_path / "cuffs.json"
    cuffs.write_text(json.dumps({"cuffs": CUFFS}), encoding="utf-8")
    beyond_warm_s = float(_run("-c", USE, str(installed), str(cuffs), **environment))
    assert beyond_warm_s < MOST_BEYOND_WARM_S
    station = "from station.__main__ import main; main()"
    _run("-c", station, "rmr", "--every", "100", "--output", str(tmp_path / "rmr.csv"), **environment)
    assert not [path for path in kept.rglob("*") if path.is_file()], "what was compiled"


def _run(*arguments: str, **environment: str) -> str:
    """Run Python; stdout. From the checkout only to build, so that the rest imports the installed packages."""
    folder = ROOT if not environment else Path(environment["PYTHONPATH"])
    ran = subprocess.run(  # noqa: S603
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout

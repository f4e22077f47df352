"""Build a wheel with compiled kernels for this platform: `python -m solver.kernel_wheel OUTPUT`, in a source checkout.

The wheel is for the version of Python that runs this, and its kernels are for the version of numba that it has. With
another one, or on a processor without the instructions of TARGETS, an installed wheel compiles at its first
use, as the source does. Where the setuptools that pyproject.toml asks for is installed, no package index is needed.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from importlib import import_module, metadata
from pathlib import Path

from solver.compile_ahead import KERNELS, compile_ahead, print_count

ROOT = Path(__file__).parents[1]
LEFT_OUT = (".*", "__pycache__", "*.egg-info", "tests", "benchmarks", "docs", "examples", "build", "dist", "simulated")


def build(output: Path) -> None:
    """Copy the source, add the machine code of its kernels to the copy, and build the wheel from it.

    Kernels that were compiled for the processor of the wheel before, from the same source, are not compiled again.
    """
    from solver.compiled import TARGETS

    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "source"
        shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(*LEFT_OUT))
        processor, _ = TARGETS[platform.machine().lower().replace("amd64", "x86_64")]
        target = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "PYTHONPATH": str(ROOT)}
        run = (sys.executable, "-m", "solver.kernel_wheel", "--compile", str(source / "solver" / "kernels"))
        subprocess.run(run, cwd=ROOT, env={**os.environ, **target}, check=True)  # noqa: S603
        tags = {
            "--python-tag": f"cp{sys.version_info.major}{sys.version_info.minor}",
            "--plat-name": sysconfig.get_platform().replace("-", "_").replace(".", "_"),
        }
        settings = [f"--config-settings=--build-option={option}={tag}" for option, tag in tags.items()]
        offline = ["--no-build-isolation"] if _has_setuptools() else []
        pip = (sys.executable, "-m", "pip", "wheel", "--no-deps", *offline, "--wheel-dir", str(output))
        subprocess.run([*pip, *settings, str(source)], check=True)  # noqa: S603


def _has_setuptools() -> bool:
    """Whether this environment has the one that pyproject.toml asks for."""
    try:
        return int(metadata.version("setuptools").split(".")[0]) >= 77
    except metadata.PackageNotFoundError:
        return False


def compile_kernels(folder: Path) -> None:
    """Compile all kernels, or load those that are compiled, and write their machine code into the folder."""
    from solver.compiled import ship_kernel

    compile_ahead(print_count)
    for module, name in KERNELS:
        ship_kernel(getattr(import_module(module), name), folder)


def main() -> None:
    """Build the wheel; --compile is how it starts itself for the processor of the wheel."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("output", type=Path, help="folder of the wheel")
    options.add_argument("--compile", action="store_true", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    (compile_kernels if chosen.compile else build)(chosen.output)


if __name__ == "__main__":
    main()

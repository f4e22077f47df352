"""Check that the dependencies can be installed from wheels only, on every platform: python -m benchmarks.wheels

Each platform's set is resolved by uv, on this machine, with the markers of that platform; nothing is installed. Exit
code 1: a supported platform lacks a wheel. Without a package index the platforms are skipped with a message, and the
code is 0.
"""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUPPORTED = {
    "Windows, x86-64": "x86_64-pc-windows-msvc",
    "macOS, arm64": "aarch64-apple-darwin",
    "Linux, x86-64": "x86_64-manylinux_2_28",
    "Linux, arm64": "aarch64-manylinux_2_28",
}
UNSUPPORTED = {"Windows, arm64": "aarch64-pc-windows-msvc", "macOS, x86-64": "x86_64-apple-darwin"}
"""Platforms for which a package has no wheel; tried in order to notice a change."""
LEAST_PYTHON = "3.11"
OPTIONS = f"--python-version {LEAST_PYTHON} --extra station --only-binary :all: --no-header --no-annotate --quiet"
UNREACHABLE = ("failed to fetch", "error sending request", "network was disabled", "dns error", "timed out", "no cache")


@dataclass(frozen=True)
class Resolution:
    """count of packages, 0 where there is none; is_offline: no index answered; why in the message of uv."""

    count: int
    is_offline: bool
    why: str


def resolve(target: str, project: Path = ROOT / "pyproject.toml") -> Resolution:
    """The set for one platform, in uv's name for it: of everything that README's set-up line installs."""
    compiled = [sys.executable, "-m", "uv", "pip", "compile", str(project), "--python-platform", target]
    command = [*compiled, *OPTIONS.split()]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, env=environment())  # noqa: S603
    if ran.returncode == 0:
        return Resolution(sum("==" in line for line in ran.stdout.splitlines()), False, "")
    return refused(ran.stderr)


def refused(message: str) -> Resolution:
    """Resolution of a refusal by uv."""
    why = " ".join(message.split()) or "uv ended without a message"
    return Resolution(0, any(sign in why.lower() for sign in UNREACHABLE), why)


def environment() -> dict[str, str]:
    """Environment with pip's index and certificates for uv."""
    given = {"UV_DEFAULT_INDEX": _pip_setting("index-url"), "SSL_CERT_FILE": _pip_setting("cert")}
    return {**{name: value for name, value in given.items() if value}, **os.environ}


def main() -> int:
    is_good = True
    for platform, target in {**SUPPORTED, **UNSUPPORTED}.items():
        found = resolve(target)
        if found.is_offline:
            print(f"skipped: no package index can be reached ({found.why[:200]})", file=sys.stderr)
            return 0
        state = f"{found.count} packages, all with wheels" if found.count else f"cannot be installed: {found.why}"
        print(f"{platform:16}{state}")
        is_good = is_good and (found.count > 0 or platform in UNSUPPORTED)
    return 0 if is_good else 1


def _pip_setting(name: str) -> str:
    command = [sys.executable, "-m", "pip", "config", "get"]
    environment = os.environ.get(f"PIP_{name.replace('-', '_').upper()}")
    if environment:
        return environment
    ran = subprocess.run([*command, f"global.{name}"], capture_output=True, text=True, check=False)  # noqa: S603
    return ran.stdout.strip() if ran.returncode == 0 else ""


if __name__ == "__main__":
    sys.exit(main())

"""A signature of a session's folder with an SSH key of the laboratory's, made and checked by OpenSSH's ssh-keygen."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from fitting.seal import Standing
from station.checksums import CHECKSUMS_FILE, write_checksums
from station.errors import StationError
from station.files.chain import Link, verify_folder

SIGNATURE_FILE = f"{CHECKSUMS_FILE}.sig"
NAMESPACE = "cuffstation"
TIMEOUT_S = 60.0
NOT_SIGNED = (CHECKSUMS_FILE, SIGNATURE_FILE)


class SignatureError(StationError):
    """The folder cannot be signed, or its signature not be checked; one sentence."""


def sign(folder: Path, key: Path) -> Path:
    """Records every file of the folder in SHA256SUMS, signs that, and returns the signature's path.

    key is a private key, or a public one whose private key an agent holds. A passphrase is asked for on the terminal.
    """
    breaks = [link for link in verify_folder(folder) if link.standing.is_break]
    if broken := [str(link) for link in breaks if not link.what.endswith(".jsonl")]:  # a journal grows as it should
        raise SignatureError(
            f"{folder} is not signed, its chain is broken at {broken[0]}; see `station verify {folder}`"
        )
    files = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
    write_checksums(*(path for path in files if path.name not in NOT_SIGNED))
    signature = folder / SIGNATURE_FILE
    signature.unlink(missing_ok=True)
    answer = _ssh_keygen("-Y", "sign", "-f", str(key), "-n", NAMESPACE, str(folder / CHECKSUMS_FILE))
    if answer.returncode != 0 or not signature.is_file():
        raise SignatureError(f"{folder} is not signed: ssh-keygen says {_words(answer)}")
    return signature


def signature_of(folder: Path, signers: Path | None) -> Link | None:
    """The link of the signature: by whom, and whether it fits; None where the folder is not signed and need not be.

    signers is OpenSSH's file of allowed signers. Without it the signature is checked, and whose key it is is left open.
    """
    signature, sums = folder / SIGNATURE_FILE, folder / CHECKSUMS_FILE
    what = f"{SIGNATURE_FILE} ← {CHECKSUMS_FILE}"
    if not signature.is_file() or not sums.is_file():
        return None if signers is None else Link(what, Standing.MISSING, "the folder is not signed")
    if signers is None:
        answer = _ssh_keygen("-Y", "check-novalidate", "-n", NAMESPACE, "-s", str(signature), content=sums)
        return _link(what, answer, "; give --signers to check whose key it is")
    if not signers.is_file():
        raise SignatureError(f"{signers} is no file, expected OpenSSH's list of allowed signers")
    found = _ssh_keygen("-Y", "find-principals", "-f", str(signers), "-s", str(signature))
    principal = found.stdout.strip().splitlines()
    if found.returncode != 0 or not principal:
        return Link(what, Standing.CHANGED, f"signed with a key that is not in {signers.name}")
    command = ("-Y", "verify", "-f", str(signers), "-I", principal[0], "-n", NAMESPACE, "-s", str(signature))
    return _link(what, _ssh_keygen(*command, content=sums))


def _link(what: str, answer: subprocess.CompletedProcess[str], remark: str = "") -> Link:
    standing = Standing.AS_RECORDED if answer.returncode == 0 else Standing.CHANGED
    return Link(what, standing, _words(answer) + (remark if answer.returncode == 0 else ""))


def _ssh_keygen(*arguments: str, content: Path | None = None) -> subprocess.CompletedProcess[str]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise SignatureError("there is no ssh-keygen on this computer; install OpenSSH 8.1 or newer")
    try:
        with Path(content or os.devnull).open("rb") as said:
            return subprocess.run(  # noqa: S603  (no shell; the arguments are ours and the user's paths)
                [program, *arguments],
                stdin=said,
                capture_output=True,
                check=False,
                encoding="utf-8",
                errors="replace",
                timeout=TIMEOUT_S,
            )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SignatureError(f"ssh-keygen cannot be used: {error}") from error


def _words(answer: subprocess.CompletedProcess[str]) -> str:
    """What it said, on one line."""
    return " ".join(f"{answer.stdout} {answer.stderr}".split()) or f"exit code {answer.returncode}"

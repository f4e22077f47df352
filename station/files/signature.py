"""Sign a session folder with an SSH key of the laboratory, and verify the signature, with ssh-keygen of OpenSSH."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from fitting.results.standing import Standing
from station.checksums import CHECKSUMS_FILE, SIGNATURE_FILE, files_below, write_checksums
from station.errors import StationError
from station.files.chain import Link
from station.messages.file_codes import ChainCode
from station.messages.message import Message

NAMESPACE = "cuffstation"
TIMEOUT_S = 60.0


class SignatureError(StationError):
    """The folder cannot be signed, or its signature cannot be verified."""


def sign(folder: Path, key: Path, links: Sequence[Link]) -> Path:
    """Sign the list of hashes of a folder without a broken link. Returns the path of the signature.

    key: a private key, or a public one whose private key is in an agent. A passphrase is read from the terminal.
    links: the verification of the folder
    """
    if broken := [str(link) for link in links if link.standing.is_break]:
        raise SignatureError(Message(ChainCode.BROKEN, {"folder": str(folder), "link": broken[0]}))
    write_checksums(*(folder / name for name in files_below(folder)))  # without a list, or with a longer journal
    signature = folder / SIGNATURE_FILE
    signature.unlink(missing_ok=True)
    answer = _ssh_keygen("-Y", "sign", "-f", str(key), "-n", NAMESPACE, str(folder / CHECKSUMS_FILE))
    if answer.returncode != 0 or not signature.is_file():
        raise SignatureError(Message(ChainCode.NOT_SIGNED, {"folder": str(folder), "reason": _one_line(answer)}))
    return signature


def signature_of(folder: Path, signers: Path | None) -> Link | None:
    """The link of the signature with the name of the signer; None for an unsigned folder without a list of signers.

    signers: the file of allowed signers of OpenSSH; without it, the owner of the key is not verified.
    """
    signature, sums = folder / SIGNATURE_FILE, folder / CHECKSUMS_FILE
    step = f"{SIGNATURE_FILE} ← {CHECKSUMS_FILE}"
    if not signature.is_file() or not sums.is_file():
        return None if signers is None else Link(step, Standing.MISSING, "the folder is not signed")
    if signers is None:
        answer = _ssh_keygen("-Y", "check-novalidate", "-n", NAMESPACE, "-s", str(signature), content=sums)
        return _link(step, answer, "; give --signers to verify the owner of the key")
    if not signers.is_file():
        raise SignatureError(Message(ChainCode.NO_SIGNERS, {"path": str(signers)}))
    found = _ssh_keygen("-Y", "find-principals", "-f", str(signers), "-s", str(signature))
    principal = found.stdout.strip().splitlines()
    if found.returncode != 0 or not principal:
        return Link(step, Standing.CHANGED, f"signed with a key that is not in {signers.name}")
    command = ("-Y", "verify", "-f", str(signers), "-I", principal[0], "-n", NAMESPACE, "-s", str(signature))
    return _link(step, _ssh_keygen(*command, content=sums))


def _link(step: str, answer: subprocess.CompletedProcess[str], remark: str = "") -> Link:
    standing = Standing.AS_RECORDED if answer.returncode == 0 else Standing.CHANGED
    return Link(step, standing, _one_line(answer) + (remark if answer.returncode == 0 else ""))


def _ssh_keygen(*arguments: str, content: Path | None = None) -> subprocess.CompletedProcess[str]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise SignatureError(Message(ChainCode.NO_SSH_KEYGEN))
    try:
        with Path(content or os.devnull).open("rb") as signed:
            return subprocess.run(  # noqa: S603  (no shell; the arguments are ours and the user's paths)
                [program, *arguments],
                stdin=signed,
                capture_output=True,
                check=False,
                encoding="utf-8",
                errors="replace",
                timeout=TIMEOUT_S,
            )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SignatureError(Message(ChainCode.SSH_KEYGEN_FAILED, {"reason": str(error)})) from error


def _one_line(answer: subprocess.CompletedProcess[str]) -> str:
    """The output of ssh-keygen on one line."""
    return " ".join(f"{answer.stdout} {answer.stderr}".split()) or f"exit code {answer.returncode}"

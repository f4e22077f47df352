"""Run a command in a network that is nothing but a loopback: `python -m tests.drivers.own_loopback COMMAND …`.

liblsl binds its servers to all addresses and has no setting for one. Here all addresses are this process's own. Exits
with CANNOT where the system allows no such network (another system than Linux, user namespaces that are switched off).
"""

import ctypes
import os
import socket
import struct
import sys
from pathlib import Path

CANNOT = 77
_CLONE_NEWUSER, _CLONE_NEWNET = 0x1000_0000, 0x4000_0000
_SIOCSIFFLAGS, _IFF_UP = 0x8914, 0x1


def main() -> None:
    try:
        _enter()
    except (OSError, AttributeError, ImportError) as error:
        print(error, file=sys.stderr)
        sys.exit(CANNOT)
    os.execvp(sys.argv[1], sys.argv[1:])  # noqa: S606


def _enter() -> None:
    import fcntl

    user, group = os.getuid(), os.getgid()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), "no network of its own")
    Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1", encoding="ascii")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1", encoding="ascii")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH14x", b"lo", _IFF_UP))


if __name__ == "__main__":
    main()

"""The command `station`, also as `python -m station` where the environment's scripts are not on the path.

It imports almost nothing, so that Ctrl-C is handled while the verbs are being imported, and a limit of memory (ulimit
-v, -d) before a native library needs what the limit denies: OpenBLAS then waits for ever.
"""

from __future__ import annotations

import gc
import mmap
import os
import sys
from itertools import pairwise
from typing import NoReturn

from station.exit_code import ENDED_BY_CTRL_C, FAILED, INTERRUPTED

LEAST, LEAST_TO_COMPILE, LEAST_TO_QUERY, SPARE = 400 * 2**20, 600 * 2**20, 1200 * 2**20, 2**26
"""Bytes: of the libraries that every verb imports; with LLVM or with DuckDB, which abort below; and what a failing verb
leaves if memory was not the cause.
"""
WITHOUT_COMPILER = ("info", "recover", "import", "judge", "fit", "export", "verify", "init")
WITH_COMPILER = {"--osim", "--recompute", "--to=parquet"}
"""Verbs that load no LLVM, and their arguments with which they load it, or Arrow, which needs as much."""
BLAS_SIZE = 128
"""Rows of matrices large enough for OpenBLAS to allocate the memory that it keeps."""
SHORT_OF_MEMORY = "station: the memory of this computer, or its limit for this command, is not sufficient"


def main() -> NoReturn:
    """Import the verbs and run one."""
    # The last digits of a matrix product depend on the number of threads; the same input must give the same bytes.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(20_000)  # imports and arrays leave no cycles behind: looking for them takes 5 % of a verb
    try:
        if _has_limit():
            _allocate_first()
        from station.cli import main as run

        run()
    except KeyboardInterrupt:
        print(ENDED_BY_CTRL_C, file=sys.stderr, flush=True)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not isinstance(error, MemoryError) and not (_has_limit() and not _is_free(SPARE)):
            raise
        print(SHORT_OF_MEMORY, file=sys.stderr, flush=True)
        sys.exit(FAILED)


def _has_limit() -> bool:
    if sys.platform == "win32":
        return False
    import resource

    kinds = (resource.RLIMIT_AS, resource.RLIMIT_DATA)
    return any(resource.getrlimit(kind)[0] != resource.RLIM_INFINITY for kind in kinds)


def _is_free(size: int) -> bool:
    """Whether the limits leave so many bytes."""
    try:
        mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
    except OSError:
        return False
    return True


def _allocate_first() -> None:
    """Let both copies of OpenBLAS allocate what they keep. Raises MemoryError where the limits leave too little."""
    verb = next(iter(sys.argv[1:]), "-")
    options = {*sys.argv, *map("=".join, pairwise(sys.argv))}
    is_light = verb.startswith("-") or (verb in WITHOUT_COMPILER and not options & WITH_COMPILER)
    if not _is_free(LEAST_TO_QUERY if verb == "catalogue" else LEAST if is_light else LEAST_TO_COMPILE):
        raise MemoryError
    import numpy as np
    from scipy import linalg

    square = np.eye(BLAS_SIZE)
    linalg.solve(square, np.linalg.solve(square, square @ square))


if __name__ == "__main__":
    main()

"""Share of the mutations of a module that its tests detect.

    python -m benchmarks.mutations [MODULE ...] [--at TEXT] [--processes N]

Changes one operator, comparison, condition, constant or returned value of a module at a time and runs the tests of the
module: those of the mirrored file, and those of MODULES below. Prints every mutation that no test detects, with its
line, the share that is detected, and the processor time. A mutation that changes nothing that a user can see is listed
with its reason in harmless_mutations.toml, by the text of its line. Without MODULE, all of MODULES are tested; --at
tests only the mutations of lines with TEXT. The exit code is 1 if a mutation survives that is not listed, or if a
listed one is detected.

No file is changed: a child process imports the mutated code, and everything that imports it; all other modules are
imported once, before the fork. A process that a test starts has the original code. The tests that execute the changed
line run first, the fastest of them at the beginning, and the first failure ends the run. Linux and macOS only.
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

import pytest

from benchmarks.mutants import Mutation, list_mutations

ROOT = Path(__file__).parents[1]
HARMLESS_FILE = Path(__file__).with_name("harmless_mutations.toml")
FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents", "tests", "benchmarks")
MODULES: dict[str, tuple[str, ...]] = {  # module → test files besides tests/FOLDER/test_MODULE.py
    "fitting.static.held_loads": ("tests/fitting/static/test_held_loads.py",),
    "fitting.static.stiffness": ("tests/fitting/static/test_held_loads.py",),
    "fitting.study.power": (),
    "fitting.study.restricted_likelihood": ("tests/fitting/study/test_variance_components.py",),
    "fitting.study.variance_components": (),
    "fitting.trial.calibration": (),
    "fitting.trial.clocks": ("tests/fitting/trial/test_sync_line.py",),
    "fitting.trial.timeline": (),
    "fitting.uncertainty": (),
    "recordings.recovery": (),
    "recordings.writer": (),
    "solver.suit.cord": ("tests/solver/test_cuff.py", "tests/solver/suit/test_assessment.py"),
    "solver.suit.decision": (),
    "solver.suit.quantity": ("tests/solver/suit/test_assessment.py",),
    "station.bench.sync_line": ("tests/station/bench/test_arming.py",),
    "station.bench.trial_state_machine": ("tests/station/bench/test_arming.py",),
    "documents.interval": (),
    "station.journal": (),
    "station.session.plan_status": (),
}
FORK = multiprocessing.get_context("fork")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", default=list(MODULES), metavar="MODULE")
    parser.add_argument("--at", default="", metavar="TEXT", help="only the mutations of lines with this text")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    options = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a process with threads cannot be forked safely
    os.chdir(ROOT)
    os.nice(10)
    is_sound = True
    for name in options.modules:  # in a process of its own: modules imported for one contain the code of the next
        process = FORK.Process(target=assess, args=(name, options.at, options.processes))
        process.start()
        process.join()
        is_sound &= process.exitcode == 0
    sys.exit(not is_sound)


def find_tests(module: str) -> list[str]:
    """Test files of a module: the one at its place in the mirrored tree, and those declared."""
    *folders, name = module.split(".")
    mirrored = Path("tests", *folders, f"test_{name}.py")
    return [str(path) for path in (mirrored, *map(Path, MODULES.get(module, ()))) if (ROOT / path).is_file()]


def harmless_mutations() -> dict[str, dict[tuple[str, str], str]]:
    """Module → (text of the line, change) → reason."""
    listed = tomllib.loads(HARMLESS_FILE.read_text())
    return {
        module: {(entry["line"], change): entry["reason"] for entry in entries for change in entry["changes"]}
        for module, entries in listed.items()
    }


def assess(module: str, at: str, processes: int) -> None:
    """Run the tests on every mutation of a module, and print the survivors. Exits with 1 if there is an unknown one."""
    tests, path = find_tests(module), ROOT / f"{module.replace('.', '/')}.py"
    if not tests:
        sys.exit(f"{module} has no test file; declare one in MODULES of benchmarks/mutations.py")
    source = path.read_text()
    with tempfile.TemporaryDirectory() as folder:
        runner = _Runner(module, str(path), tests, Path(folder))
        runner.prepare(compile(source, str(path), "exec"))
        chosen = [mutation for mutation in list_mutations(source) if at in mutation.line]
        before, harmless = _processor_seconds(), harmless_mutations().get(module, {})
        survivors = []
        for mutation in runner.survivors(chosen, processes):
            survivors.append(mutation)
            if mutation.key not in harmless:
                print(f"survives  {path.relative_to(ROOT)}:{mutation.number}  {mutation.line}")
                print(f"          {mutation.change}", flush=True)
    unknown = [mutation for mutation in survivors if mutation.key not in harmless]
    lost = {m.key for m in chosen if m.key in harmless} - {mutation.key for mutation in survivors}
    for line, change in sorted(lost):
        print(f"detected, although listed as harmless  {path.relative_to(ROOT)}  {line}\n          {change}")
    killed = len(chosen) - len(survivors)
    print(
        f"{module}: {killed} of {len(chosen)} mutations detected ({killed / max(1, len(chosen)):.0%}), "
        f"{len(survivors) - len(unknown)} harmless, {len(unknown)} survive; "
        f"{_processor_seconds() - before:.0f} s of processor, {runner.seconds:.1f} s the tests without a mutation",
        flush=True,
    )
    sys.exit(bool(unknown or lost))


def _processor_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@dataclass
class _Runner:
    """Runs the tests of a module in child processes that import given code as the module."""

    module: str
    path: str
    tests: list[str]
    folder: Path
    seconds: float = 0.0  # processor time of the tests on the original code, with the trace of their lines
    _traced: dict[str, _TracedTest] = field(default_factory=dict)
    _limit: float = 600.0  # wall time of one run [s]
    _started: int = field(default=0)

    def prepare(self, original: CodeType) -> None:
        """Run the tests on the original code, import what they imported and does not depend on the module, and run
        them again as on a mutation.
        """
        receiver, sender = FORK.Pipe(duplex=False)
        trace = _Trace(self.path)

        def report() -> None:
            usage = resource.getrusage(resource.RUSAGE_SELF)
            seconds = usage.ru_utime + usage.ru_stime
            sender.send((sorted(sys.modules), seconds, time.monotonic() - begun, trace.tests))

        begun = time.monotonic()
        process = self._start(original, trace, report)
        names, self.seconds, wall, self._traced = receiver.recv() if receiver.poll(self._limit) else ([], 0.0, 0.0, {})
        self._ensure_passed(process)
        self._limit = 20.0 + 20.0 * wall
        for name in _independent(names, self.module):
            with suppress(ImportError):
                import_module(name)
        self._ensure_passed(self._start(original, _Order(self._traced, 0)))

    def _ensure_passed(self, process: BaseProcess) -> None:
        process.join()
        if process.exitcode:
            sys.exit(f"{self.module}: its tests fail without a mutation: pytest {' '.join(self.tests)}")

    def survivors(self, mutations: Iterable[Mutation], processes: int) -> Iterator[Mutation]:
        """The mutations with which all tests pass."""
        waiting = list(mutations)
        running: dict[Any, tuple[Mutation, BaseProcess, float]] = {}
        while waiting or running:
            while waiting and len(running) < processes:
                mutation = waiting.pop(0)
                process = self._start(mutation.compiled(self.path), _Order(self._traced, mutation.number))
                running[process.sentinel] = mutation, process, time.monotonic() + self._limit
            ended = wait(list(running), max(0.0, min(end for *_, end in running.values()) - time.monotonic()))
            late = [key for key, (*_, end) in running.items() if key not in ended and time.monotonic() > end]
            for key in [*ended, *late]:
                mutation, process, _ = running.pop(key)
                assert process.pid is not None  # noqa: S101  (it was started)
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)  # also what its tests have started
                process.join()
                if process.exitcode == pytest.ExitCode.INTERNAL_ERROR:
                    sys.exit(f"{self.module}: pytest itself failed at {mutation.line}: {mutation.change}")
                if process.exitcode == 0:
                    yield mutation

    def _start(self, code: CodeType, plugin: object, report: Callable[[], None] = lambda: None) -> BaseProcess:
        self._started += 1
        process = FORK.Process(target=self._run, args=(code, self.folder / str(self._started), plugin, report))
        process.start()
        return process

    def _run(self, code: CodeType, folder: Path, plugin: object, report: Callable[[], None]) -> None:
        """In the child: import the code as the module, run the tests, and end with 0 if all pass."""
        os.setsid()
        limit = int(5 + 5 * self.seconds) if self.seconds else 600
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        null = os.open(os.devnull, os.O_RDWR)
        for descriptor in range(3):
            os.dup2(null, descriptor)
        sys.meta_path.insert(0, _Finder(self.module, code))  # type: ignore[arg-type]
        options = ["-x", "-q", "-n0", "-pno:cacheprovider", "--assert=plain", f"--basetemp={folder}"]
        outcome = int(pytest.main([*options, *self.tests], plugins=[plugin]))
        report()
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(outcome)


@dataclass
class _TracedTest:
    """Lines of the module that a test executes, and its wall time [s]."""

    lines: set[int] = field(default_factory=set)
    seconds: float = 0.0


class _Trace:
    """Plugin of pytest that notes the lines of a file that every test executes."""

    def __init__(self, path: str) -> None:
        self.tests: dict[str, _TracedTest] = {}
        self._path = path

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        test = self.tests[item.nodeid] = _TracedTest()

        def trace(frame: FrameType, event: str, argument: object) -> Any:  # noqa: ARG001
            if frame.f_code.co_filename != self._path:
                return None
            test.lines.add(frame.f_lineno)
            return trace

        begun = time.perf_counter()
        threading.settrace(trace)
        sys.settrace(trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)
            test.seconds = time.perf_counter() - begun


class _Order:
    """Plugin of pytest that runs the tests that execute a line first, the fastest of them at the beginning."""

    def __init__(self, traced: dict[str, _TracedTest], line: int) -> None:
        self._traced, self._line = traced, line

    @pytest.hookimpl(trylast=True)  # after those that are left out
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        def key(item: pytest.Item) -> tuple[bool, float]:
            test = self._traced.get(item.nodeid, _TracedTest())  # its name may contain a constant that is changed
            return self._line not in test.lines, test.seconds

        items.sort(key=key)


class _Finder:
    """Finds one module with other code than that of its file."""

    def __init__(self, module: str, code: CodeType) -> None:
        self._module, self._code = module, code

    def find_spec(self, name: str, path: list[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != self._module or (spec := PathFinder.find_spec(name, path, target)) is None or not spec.origin:
            return None
        spec.loader = _Loader(name, spec.origin)
        spec.loader.code = self._code
        return spec


class _Loader(SourceFileLoader):
    code: CodeType

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002
        return self.code


def _independent(names: Iterable[str], module: str) -> list[str]:
    """Of the modules imported by a run those that can be imported before the module changes: no file of ours that
    imports it, directly or not, and no test or fixture.
    """
    names = list(names)
    ours = {name: path for name in names if (path := _path(name)) is not None}
    imports = {name: _imports(path) for name, path in ours.items()}
    dependent, found = set[str](), {module}
    while found:
        dependent |= found
        found = {name for name, imported in imports.items() if imported & dependent} - dependent
    return [
        name
        for name in names
        if not (name.startswith("_") or name in dependent or "conftest" in name or ".test_" in name)
    ]


def _path(name: str) -> Path | None:
    """The file of a module of this project."""
    if name.partition(".")[0] not in FOLDERS:
        return None
    path = ROOT / name.replace(".", "/")
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


def _imports(path: Path) -> set[str]:
    """Names of modules, and of what may be one, that a file imports anywhere."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


if __name__ == "__main__":
    main()

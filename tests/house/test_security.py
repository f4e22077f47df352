"""Statements of docs/security.md: no code of a file is run, servers listen on this computer only, nothing is sent."""

import ast
import re
import sys
from collections.abc import Iterable
from contextlib import nullcontext
from ipaddress import ip_address
from pathlib import Path
from unittest.mock import MagicMock

import psutil
import pytest

from station import dask_cluster
from station.bench.simulation import SimulatedBench, simulator_settings
from station.checksums import JOURNAL_FILE
from station.config import ConfigError, parse_config
from station.journal import JournalError, read_journal
from station.messages.session_messages import JournalCode
from station.messages.setup_messages import ConfigCode
from station.viewer import viewer as rerun_viewer
from tests.house.sources import SOURCES, name_of, nodes_of
from tests.refusals import raises_refusal

RUNS_CODE = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "yaml", "joblib"}
WORKER = "station/session/worker.py"
"""It unpickles what comes through the inherited pipe between a session and its own process, and no file."""
CALLS = {"eval", "exec", "compile", "__import__"}
SHELLS = {"system", "popen", "getoutput", "getstatusoutput", "create_subprocess_shell"}
ANYWHERE = re.compile(r"0\.0\.0\.0|^::$|\[::\]")


def _offences(nodes: Iterable[ast.AST]) -> list[str]:
    found = []
    for node in nodes:
        match node:
            case ast.Import(names=names) if {name.name.split(".")[0] for name in names} & RUNS_CODE:
                found.append(f"line {node.lineno} imports what runs code out of files")
            case ast.ImportFrom(module=str(module), names=names) if module.split(".")[0] in RUNS_CODE:
                if all(name.name.endswith("Error") for name in names):
                    continue  # an exception runs nothing
                found.append(f"line {node.lineno} imports from {module}")
            case ast.Call(func=ast.Name(id=name)) if name in CALLS:
                found.append(f"line {node.lineno} calls {name}")
            case ast.Call(func=ast.Attribute(attr=name)) if name in SHELLS:
                found.append(f"line {node.lineno} calls {name}")
            case ast.keyword(arg="shell" | "allow_pickle", value=ast.Constant(value=True)):
                found.append("shell=True or allow_pickle=True")
            case ast.Constant(value=str(text)) if ANYWHERE.search(text):
                found.append(f"line {node.lineno} names every address: {text!r}")
    return found


def test_no_file_runs_code_of_another_or_listens_everywhere() -> None:
    offences = {name_of(path): _offences(nodes_of(path)) for path in SOURCES}
    assert len(offences.pop(WORKER)) == 1
    assert {name: found for name, found in offences.items() if found} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from yaml import load",
        "from pickle import UnpicklingError, loads",
        "eval(text)",
        "os.system(text)",
        "run(text, shell=True)",
        "np.load(path, allow_pickle=True)",
        "bind(('0.0.0.0', 1))",
    ],
)
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert _offences(ast.walk(ast.parse(source)))


def test_the_simulated_devices_listen_on_this_machine_alone() -> None:
    settings = simulator_settings(parse_config({}, "t")) | {"ports": {"ni": 0, "qtm": 0, "serial": 0}}
    before = set(psutil.Process().children())
    with SimulatedBench(settings, 30.0, 1) as bench:
        (child,) = set(psutil.Process().children()) - before
        opened = child.net_connections("inet")
        if sys.platform == "win32":  # Wine's sockets belong to its server; nsiproxy.sys/tcp.c searches the processes
            opened = [
                each for each in psutil.net_connections("inet") if each.laddr.port in bench.ready["ports"].values()
            ]
        addresses = [each.laddr for each in opened if each.status == psutil.CONN_LISTEN]
    assert len(addresses) >= 3
    assert all(ip_address(address.ip.removeprefix("::ffff:")).is_loopback for address in addresses)


def test_the_workers_of_a_sweep_listen_on_this_machine_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    cluster = MagicMock(return_value=nullcontext("inproc://nowhere"))
    monkeypatch.setattr(dask_cluster, "LocalCluster", cluster)
    monkeypatch.setattr(dask_cluster, "Client", MagicMock(side_effect=OSError("no such user")))
    with pytest.raises(dask_cluster.ClusterError), dask_cluster.connected(None, 1):
        pass
    asked = cluster.call_args.kwargs
    assert asked["host"] == "127.0.0.1"
    assert asked["scheduler_kwargs"] == {"dashboard": False}
    assert {asked["dashboard_address"], asked["worker_dashboard_address"]} == {"127.0.0.1:0"}


def test_rerun_s_viewer_listens_on_this_machine_and_sends_no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    started = MagicMock()
    started.return_value.poll.return_value = 1  # it has ended
    monkeypatch.setattr(rerun_viewer.subprocess, "Popen", started)
    with pytest.raises(rerun_viewer.ViewerError):
        rerun_viewer.start_viewer()
    (words,), asked = started.call_args
    assert words[words.index("--bind") + 1] == "127.0.0.1"
    assert (asked["env"]["RERUN_ANALYTICS_ENABLED"], asked["env"]["DO_NOT_TRACK"]) == ("false", "1")


@pytest.mark.parametrize("name", ["../hand", "a/b", "a\\b", "..", "", "C:x", "hand\n", "{0}"])
def test_a_cuff_s_name_cannot_lead_out_of_the_session_s_folder(name: str) -> None:
    cuff = {"site": "arm", "anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
    with raises_refusal(ConfigCode.WRONG_VALUE, repr(name), kind=ConfigError):
        parse_config({"cuffs": {name: cuff}}, "t")


@pytest.mark.parametrize("name", ["../other/x.mcap", "/etc/x.mcap", "..\\\\x.mcap", "C:x.mcap"])
def test_a_journal_names_no_file_outside_its_folder(tmp_path: Path, name: str) -> None:
    line = f'{{"at": "2026-01-01", "kind": "verdict", "file": "{name}", "choice": "accept", "reason": ""}}\n'
    (tmp_path / JOURNAL_FILE).write_text(line)
    with raises_refusal(JournalCode.WRONG_LINE, "line 1", kind=JournalError):
        read_journal(tmp_path)

"""Verbs on whole sessions: init, demo, serve, judge, verify, report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from documents.interval import counted
from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import ConfigPath, FormatOption, Seed, print_message


def demo(
    output: Annotated[Path | None, typer.Option(help="Session folder; default: simulated/demo.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1, help="Largest speed of the simulated bench, as a multiple of real time; default: no limit."
        ),
    ] = None,
    seed: Seed = 1,
) -> None:
    """Record a session from simulated devices, fit and assess the cuffs, write the report."""
    from station.assessment.compilation import CompilationAhead

    with CompilationAhead() as ahead:
        ahead.ensure_started()
        from station.demo import run_demo  # takes seconds, in which the second process compiles

        code = run_demo(output, speed, seed, ahead)
    raise typer.Exit(code)


def init(folder: Annotated[Path, typer.Argument(help="Folder to write into; it is created.")] = Path()) -> None:
    """Write the example configuration and the examples for Python into a folder. Prints the paths."""
    from station.files.init import write_examples

    for path in write_examples(folder):
        print(path)


def serve(
    config: ConfigPath = Path("station.toml"),
    host: Annotated[
        str, typer.Option(help="Address to listen on; other computers then need the printed token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8421,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    simulated: Annotated[bool, typer.Option(help="Practise on simulated devices.")] = False,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            help="Largest speed of the simulated bench; without --simulated, follow the clock of `station simulate`.",
        ),
    ] = None,
    seed: Seed = 1,
) -> None:
    """Serve the operator's console, a page that guides through a session. Prints its address."""
    from station.config import load_config
    from station.console.server import serve as serve_console
    from station.terminal.commands import is_interactive

    if not config.exists() and config.name == "station.toml" and is_interactive():
        print_message("There is no station.toml here. `station init` writes an example for devices on this computer.")
        if typer.confirm("Write it now?", default=True, err=True):
            init(config.parent)
    serve_console(
        load_config(config), host=host, port=port, is_opened=open_page, is_simulated=simulated, speed=speed, seed=seed
    )


def judge(
    file: Annotated[Path, typer.Argument(help="A recording in its session folder.")],
    redo: Annotated[
        str | None, typer.Option(help="Reject the recording for this reason; without it, accept it.")
    ] = None,
) -> None:
    """Accept a recording, or reject it with a reason. The session's journal keeps every decision.

    A file that cannot be read as a recording is not accepted; it may be rejected.
    """
    from recordings.reader import open_recording
    from station.checksums import changed_files
    from station.journal import write_verdict

    if not file.is_file() or file.suffix != ".mcap":
        raise typer.BadParameter(f"there is no recording {file}")
    if redo is not None and not redo.strip():
        raise typer.BadParameter("--redo is empty, expected the reason why the recording is rejected")
    if redo is None:
        open_recording(file)
    for sentence in changed_files([file]):
        print_message(str(sentence))
    write_verdict(file.parent, file.name, "redo" if redo else "accept", redo or "")
    print_message(f"{file.name} is {'rejected' if redo else 'accepted'}; `station fit` uses this decision")


def verify(
    folder: Annotated[Path, typer.Argument(help="Session folder.")],
    sign: Annotated[Path | None, typer.Option(help="Sign the folder with this SSH key if no link is broken.")] = None,
    signers: Annotated[
        Path | None, typer.Option(help="OpenSSH's file of allowed signers, to verify the signature.")
    ] = None,
    add: Annotated[
        list[Path] | None, typer.Option(help="List a file that another program added; may be repeated.")
    ] = None,
    number: Annotated[
        str | None, typer.Option(help="Follow this number of the report to its samples; the page shows its id.")
    ] = None,
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Fit and assess again from the samples, and compare every number.")
    ] = False,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Compare every file of a session with its recorded hash, and every result with the hashes of its inputs.

    Every number of the report is compared with the result it is from. Prints one line per link; exit code 1 if a file
    has changed, is missing or was added, or a number does not agree with its source.
    """
    import json
    from dataclasses import asdict

    from rich.console import Console

    from station.files.chain import add_files, check_signature
    from station.files.chain import sign as sign_folder
    from station.progress import progress_bars
    from station.report.verification import verify_session

    if number is not None:
        raise typer.Exit(_trace(folder, number, format))
    if add:
        add_files(folder, add)
    links = verify_session(folder)
    if sign is not None:
        print_message(f"signed: {sign_folder(folder, sign, links)}")
        links = verify_session(folder)
    if signed := check_signature(folder, signers):
        links.insert(0, signed)
    if recompute:
        from station.report.recomputation import recomputed_links

        with progress_bars(Console(stderr=True)) as progress:
            links += recomputed_links(folder, progress)
    if format == "json":
        print(json.dumps([{**asdict(link), "is_break": link.standing.is_break} for link in links], indent=2))
    else:
        print("\n".join(map(str, links)))
    breaks = sum(link.standing.is_break for link in links)
    unrecorded = sum(link.standing == "no hash recorded" for link in links)
    print_message(f"{counted(len(links), 'link')}, {breaks} broken, {unrecorded} without a hash to compare with")
    raise typer.Exit(FAILED if breaks else DONE)


def _trace(folder: Path, number: str, format: str) -> int:  # noqa: A002
    """Print the chain of one number; the exit code."""
    import json

    from station.report.verification import trace, trace_lines

    traced = trace(folder, number)
    if format == "json":
        print(json.dumps(traced.model_dump(mode="json", exclude_defaults=True), indent=2))
    else:
        print("\n".join(trace_lines(traced)))
    return FAILED if traced.is_broken else DONE


def report(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, cuffs.json or assessment.json.")],
    normative: Annotated[
        Path | None, typer.Option(help="normative.json of `station study`; it is copied into the folder.")
    ] = None,
    format: Annotated[  # noqa: A002
        Literal["html", "pdf"], typer.Option("--format", help="pdf: print the page as report.pdf, too (extra pdf).")
    ] = "html",
) -> None:
    """Write report.html, a self-contained page, from the recordings and results of a folder. Prints its path."""
    from rich.console import Console

    from fitting.results.codes import Standing
    from station.files.chain import trace_chain
    from station.folders import require_folder
    from station.progress import progress_bars
    from station.report.cuff_section import adopt_normative
    from station.report.page import ReportError, ensure_pdf, write_pdf, write_report

    require_folder(folder, ReportError)
    if format == "pdf":
        ensure_pdf()
    if normative is not None:
        adopt_normative(normative, folder)
    with progress_bars(Console(stderr=True)) as progress:
        written = write_report(folder, progress=progress)
    print(write_pdf(written) if format == "pdf" else written)
    links = [link for link in trace_chain(folder) if link.standing.is_break or link.standing is Standing.BY_HAND]
    for link in links:
        print_message(str(link))
    raise typer.Exit(LOSSY if any(link.standing.is_break for link in links) else DONE)

"""The whole way: demo, and the report of all that a folder holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import ConfigPath, FormatOption, Seed, say


def demo(
    output: Annotated[Path | None, typer.Option(help="Folder of the session; default: simulated/demo.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.1, help="Pace of the simulated world, at most; default: as fast as it is handled."),
    ] = None,
    seed: Seed = 1,
) -> None:
    """Record a whole session from simulated devices, fit it, assess it, report it."""
    from station.assessment.compilation import CompilationAhead

    with CompilationAhead() as ahead:
        from station.demo import run_demo  # takes seconds, in which the second process compiles

        code = run_demo(output, speed, seed, ahead)
    raise typer.Exit(code)


def serve(
    config: ConfigPath = Path("station.toml"),
    host: Annotated[str, typer.Option(help="Beyond this machine only by name: then a token is needed.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8421,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    simulated: Annotated[bool, typer.Option(help="On simulated devices, to practise or to rehearse on.")] = False,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            help="Pace of the simulated world, at most; without --simulated, follow the clock of `station simulate`.",
        ),
    ] = None,
    seed: Seed = 1,
) -> None:
    """The operator's console: a page that leads through a session, live to the verdict. Prints its address."""
    from station.config import load_config
    from station.console.server import serve as serve_console

    serve_console(
        load_config(config),
        host=host,
        port=port,
        is_opened=open_page,
        is_simulated=simulated,
        speed=speed,
        seed=seed,
    )


def judge(
    file: Annotated[Path, typer.Argument(help="A recording in its session's folder.")],
    redo: Annotated[str | None, typer.Option(help="It does not count, and this is why; without it, it counts.")] = None,
) -> None:
    """Let a recording count, or set it aside with the reason; the session's journal keeps both."""
    from station.checksums import changed_files
    from station.journal import write_verdict

    if not file.is_file() or file.suffix != ".mcap":
        raise typer.BadParameter(f"there is no recording {file}")
    if redo is not None and not redo.strip():
        raise typer.BadParameter("--redo needs the reason why the recording does not count, and it is empty")
    for sentence in changed_files([file]):
        say(sentence)
    write_verdict(file.parent, file.name, "redo" if redo else "accept", redo or "")
    say(f"{file.name} {'is set aside' if redo else 'counts'}; `station fit` goes by it")


def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of a session.")],
    sign: Annotated[
        Path | None, typer.Option(help="Then sign the folder with this SSH key, if the chain is whole.")
    ] = None,
    signers: Annotated[
        Path | None, typer.Option(help="OpenSSH's list of allowed signers, to check whose signature it is.")
    ] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Check every file of a session against what was recorded of it, from the report to the recordings.

    One line a link; exit code 1 where any has changed or is missing.
    """
    import json
    from dataclasses import asdict

    from station.files.chain import verify_folder
    from station.files.signature import sign as sign_folder
    from station.files.signature import signature_of

    links = verify_folder(folder)
    if sign is not None:
        say(f"signed: {sign_folder(folder, sign)}")
        links = verify_folder(folder)
    if signed := signature_of(folder, signers):
        links.insert(0, signed)
    if format == "json":
        print(json.dumps([{**asdict(link), "is_break": link.standing.is_break} for link in links], indent=2))
    else:
        print("\n".join(map(str, links)))
    breaks = sum(link.standing.is_break for link in links)
    unrecorded = sum(link.standing == "no hash recorded" for link in links)
    say(f"{len(links)} links, {breaks} broken, {unrecorded} without a hash to compare with")
    raise typer.Exit(FAILED if breaks else DONE)


def report(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, cuffs.json or assessment.json.")],
) -> None:
    """Write report.html, one self-contained page, of all that a folder holds. Prints its path."""
    from rich.console import Console

    from fitting.seal import Standing
    from station.files.chain import chain_of
    from station.progress import progress_bars
    from station.report.page import write_report

    with progress_bars(Console(stderr=True)) as progress:
        written = write_report(folder, progress=progress)
    print(written)
    links = [
        link for link in chain_of(folder) if link.standing in (Standing.CHANGED, Standing.MISSING, Standing.BY_HAND)
    ]
    for link in links:
        say(str(link))
    raise typer.Exit(LOSSY if any(link.standing.is_break for link in links) else DONE)

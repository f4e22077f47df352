"""Messages on configuration, session folders, installation and the simulated bench."""

from __future__ import annotations

from documents.message import Code


class ConfigCode(Code, prefix="config."):
    """Reason why the configuration cannot be used."""

    UNREADABLE = "the configuration {path} cannot be read: {reason}"
    MISSING = "there is no configuration {path}; `station init` writes an example, or give another --config"
    WRONG_SYNTAX = "{path} {reason}"
    WRONG_VALUE = "{path}: {reason}"
    UNKNOWN_KEY = "{path}: {reason}; {advice}"
    UNKNOWN_CUFF = (
        "the configuration has no cuff {name}, only {known}; add [cuffs.{name}] with its anchor_markers and "
        "cuff_markers"
    )
    NO_BOUNCE = (
        "the configuration has no [bounce], expected mass_kg of the weight and the marker on it; add the section to "
        "record a bounce trial"
    )
    NO_BODY = (
        "the configuration has no [body], expected the labels of the markers on the wearer; add the section to record "
        "a pose or a motion"
    )
    MISSING_PACKAGE = (
        "installation.missing_package",
        "{purpose} needs the package {package}, which is not installed; install its extra: "
        "pip install 'cuffstation[{extra}]'",
    )
    EXISTS = (
        "installation.file_exists",
        "{file} exists, and station init replaces no file; give another folder, or rename the file",
    )


class FolderCode(Code):
    """Reason why a folder that a command reads cannot be used."""

    NOT_A_FOLDER = "session.not_a_folder", "{folder} is not a folder; `--help` says which one to give"
    NO_RECORDING = "session.no_recording", "{folder} contains no recording of a cuff (*.mcap); record a trial first"
    NOT_USABLE = "session.not_usable", "no recording in {folder} can be used: {reasons}"
    DAMAGED = "session.damaged", "no recording in {folder} can be used; damaged: {files}: {reasons}"
    NO_TRIAL_USABLE = "donning.not_usable", "no recording can be used: {reasons}"
    SEVERAL_DONNINGS = (
        "donning.several",
        "expected recordings of one cuff in one donning, found {found}; fit the session instead",
    )
    NOTHING_TO_REPORT = (
        "report.nothing",
        "{folder} contains no recording, no cuffs.json, no assessment.json and no emg.json to report",
    )
    FILE_BESIDE_UNUSABLE = "report.file_unusable", "{path} cannot be used: {reason}; make it again"
    NO_BROWSER = (
        "report.no_browser",
        "no browser can print the report ({reason}); install Chromium, Chrome or Edge, or run `playwright install "
        "chromium`",
    )
    DEMO_NOT_EMPTY = (
        "demo.not_empty",
        "{folder} contains recordings, which the demo does not overwrite; give another --output",
    )


class SimulationCode(Code, prefix="simulation."):
    """Reason why the simulated bench does not start or does not answer."""

    NOT_RUNNING = "the simulated bench is not running; start the session again"
    ENDED = "the simulated bench ended with code {exit_code}; start the session again"
    REFUSED = "the simulated bench refused: {reason}"
    NOT_POSSIBLE = "the devices cannot be simulated: {reason}"
    WRONG_PORT = "simulation.ports.clock is {port}, expected a port number"

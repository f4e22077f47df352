"""Messages on configuration, session folders, installation and the simulated bench."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class ConfigCode(StrEnum):
    """Reason why the configuration cannot be used."""

    UNREADABLE = "config.unreadable"
    MISSING = "config.missing"
    WRONG_SYNTAX = "config.wrong_syntax"
    WRONG_VALUE = "config.wrong_value"
    UNKNOWN_KEY = "config.unknown_key"
    UNKNOWN_CUFF = "config.unknown_cuff"
    NO_BOUNCE = "config.no_bounce"
    NO_BODY = "config.no_body"
    MISSING_PACKAGE = "installation.missing_package"
    EXISTS = "installation.file_exists"


class FolderCode(StrEnum):
    """Reason why a session folder cannot be fitted or recorded into."""

    NOT_A_FOLDER = "session.not_a_folder"
    NO_RECORDING = "session.no_recording"
    NOT_USABLE = "session.not_usable"
    DAMAGED = "session.damaged"
    NO_TRIAL_USABLE = "donning.not_usable"
    SEVERAL_DONNINGS = "donning.several"
    NOTHING_TO_REPORT = "report.nothing"
    NO_BROWSER = "report.no_browser"
    DEMO_NOT_EMPTY = "demo.not_empty"


class SimulationCode(StrEnum):
    """Reason why the simulated bench does not start or does not answer."""

    NOT_RUNNING = "simulation.not_running"
    ENDED = "simulation.ended"
    REFUSED = "simulation.refused"
    NOT_POSSIBLE = "simulation.not_possible"
    WRONG_PORT = "simulation.wrong_port"


SETUP: Mapping[StrEnum, str] = {
    ConfigCode.UNREADABLE: "the configuration {path} cannot be read: {reason}",
    ConfigCode.MISSING: "there is no configuration {path}; `station init` writes an example, or give another --config",
    ConfigCode.WRONG_SYNTAX: "{path} {reason}",
    ConfigCode.WRONG_VALUE: "{path}: {reason}",
    ConfigCode.UNKNOWN_KEY: "{path}: {reason}; {advice}",
    ConfigCode.UNKNOWN_CUFF: (
        "the configuration has no cuff {name}, only {known}; add [cuffs.{name}] with its anchor_markers and "
        "cuff_markers"
    ),
    ConfigCode.NO_BOUNCE: (
        "the configuration has no [bounce], expected mass_kg of the weight and the marker on it; add the section to "
        "record a bounce trial"
    ),
    ConfigCode.NO_BODY: (
        "the configuration has no [body], expected the labels of the markers on the wearer; add the section to record "
        "a pose or a motion"
    ),
    ConfigCode.MISSING_PACKAGE: (
        "{purpose} needs the package {package}, which is not installed; install its extra: "
        "pip install 'cuffstation[{extra}]'"
    ),
    ConfigCode.EXISTS: "{file} exists, and station init replaces no file; give another folder, or rename the file",
    FolderCode.NOT_A_FOLDER: "{folder} is not a folder; give a session folder of `station record`",
    FolderCode.NO_RECORDING: "{folder} contains no recording of a cuff (*.mcap); record a trial first",
    FolderCode.NOT_USABLE: "no recording in {folder} can be used: {reasons}",
    FolderCode.DAMAGED: "{files} is damaged, and no recording in {folder} can be used: {reasons}",
    FolderCode.NO_TRIAL_USABLE: "no recording can be used: {reasons}",
    FolderCode.SEVERAL_DONNINGS: (
        "expected recordings of one cuff in one donning, found {found}; fit the session instead"
    ),
    FolderCode.NOTHING_TO_REPORT: (
        "{folder} contains no recording, no cuffs.json, no assessment.json and no emg.json to report"
    ),
    FolderCode.NO_BROWSER: (
        "no browser can print the report ({reason}); install Chromium, Chrome or Edge, or run `playwright install "
        "chromium`"
    ),
    FolderCode.DEMO_NOT_EMPTY: "{folder} contains recordings, which the demo does not overwrite; give another --output",
    SimulationCode.NOT_RUNNING: "the simulated bench is not running; start the session again",
    SimulationCode.ENDED: "the simulated bench ended with code {exit_code}; start the session again",
    SimulationCode.REFUSED: "the simulated bench refused: {reason}",
    SimulationCode.NOT_POSSIBLE: "the devices cannot be simulated: {reason}",
    SimulationCode.WRONG_PORT: "simulation.ports.clock is {port}, expected a port number",
}

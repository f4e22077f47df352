"""Codes of messages on configuration, session folders, installation and the simulated bench."""

from __future__ import annotations

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

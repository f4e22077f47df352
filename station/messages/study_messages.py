"""Messages on studies, plans of studies and the catalogue of sessions."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class StudyCode(StrEnum):
    """Reason why a study is not made, or why a session or a value is left out of it."""

    NOT_A_FOLDER = "study.not_a_folder"
    NO_SESSION = "study.no_session"
    NO_USABLE_SESSION = "study.no_usable_session"
    MIXED_ORIGIN = "study.mixed_origin"
    NOT_FITTED = "study.session_not_fitted"
    NO_JOURNAL = "study.no_journal"
    NO_VOLUNTEER = "study.no_volunteer_code"
    UNREADABLE = "study.session_unreadable"
    NOT_IDENTIFIED = "study.not_identified"
    WRONG_FILE = "study.wrong_file"
    WRONG_NORMATIVE = "normative.wrong_file"


class CatalogueCode(StrEnum):
    """Reason why the catalogue is not built or queried, or why a session in it has no values."""

    NOT_A_FOLDER = "catalogue.not_a_folder"
    NOT_CREATED = "catalogue.not_created"
    NOT_OPENED = "catalogue.not_opened"
    OTHER_DATABASE = "catalogue.other_database"
    WRONG_SQL = "catalogue.wrong_sql"
    NO_QUERY = "catalogue.no_query"
    WRONG_PARTICIPANTS = "catalogue.wrong_participants"
    UNREADABLE = "catalogue.session_unreadable"


class PlanCode(StrEnum):
    """Reason why a study is not planned."""

    UNREADABLE = "study_plan.unreadable"
    WRONG_TABLE = "study_plan.wrong_table"
    NO_PROTOCOL = "study_plan.no_protocol_section"
    TOO_MANY_DESIGNS = "study_plan.too_many_designs"


STUDY: Mapping[StrEnum, str] = {
    StudyCode.NOT_A_FOLDER: "{folder} is not a folder; give session folders, or a folder that holds them",
    StudyCode.NO_SESSION: "{folders} holds no session: no folder has a cuffs.json; fit sessions with `station fit`",
    StudyCode.NO_USABLE_SESSION: "none of {sessions:.0f} sessions can be used: {left_out}",
    StudyCode.MIXED_ORIGIN: (
        "measured and simulated sessions cannot be in one study: {measured} is measured, {simulated} is simulated; "
        "name the folders of one kind"
    ),
    StudyCode.NOT_FITTED: "{session} is left out: it has no cuffs.json; fit it with `station fit`",
    StudyCode.NO_JOURNAL: (
        "{session} is left out: it has no session.jsonl, which has the volunteer's code; copy it beside cuffs.json"
    ),
    StudyCode.NO_VOLUNTEER: (
        "{session} is left out: its session.jsonl has no volunteer's code, as where trials are recorded one by one "
        "(`station record --test`); record sessions with `station record --subject` or `station serve`"
    ),
    StudyCode.UNREADABLE: "{session} is left out: {reason}",
    StudyCode.NOT_IDENTIFIED: "{session}: {quantity} of {cuff}, donning {donning}, is left out: {reason}",
    StudyCode.WRONG_FILE: "{path} is not a study: {reason}; make it again with `station study`",
    StudyCode.WRONG_NORMATIVE: (
        "{path} cannot be used as a normative table: {reason}; give a normative.json of `station study`"
    ),
    CatalogueCode.NOT_A_FOLDER: "{folder} is not a folder; give the folder that holds the sessions",
    CatalogueCode.NOT_CREATED: (
        "the catalogue {path} cannot be created: {reason}; give a file in a folder that you can write to, with --output"
    ),
    CatalogueCode.NOT_OPENED: (
        "the catalogue {path} cannot be opened: {reason}; close the program that uses it, or build it again with "
        "--rebuild if it is damaged"
    ),
    CatalogueCode.OTHER_DATABASE: "{path} is another database, not a catalogue; give another file with --output",
    CatalogueCode.NO_QUERY: "--sql has {found}, expected one query; start it with SELECT",
    CatalogueCode.WRONG_SQL: "the query failed: {reason}",
    CatalogueCode.WRONG_PARTICIPANTS: "{path} cannot be used as participants.tsv of BIDS: {reason}",
    CatalogueCode.UNREADABLE: "{session} has no values in the catalogue: {reason}",
    PlanCode.UNREADABLE: "{path} cannot be read as the plan of a study in TOML: {reason}",
    PlanCode.WRONG_TABLE: "the plan of a study {path}: {reason}; docs/study.md has an example",
    PlanCode.NO_PROTOCOL: "{path} has no section [protocol]; give the configuration of the station with --config",
    PlanCode.TOO_MANY_DESIGNS: "the plan has {designs:.0f} designs, expected at most {most:.0f}; name fewer choices",
}

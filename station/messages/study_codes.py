"""Codes of messages on studies, plans of studies and the catalogue of sessions."""

from __future__ import annotations

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

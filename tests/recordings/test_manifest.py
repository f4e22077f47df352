"""The manifest survives its file, and what later versions add to it."""

import json
import re

import pytest

from recordings.errors import RecordingCode
from recordings.manifest import manifest_from_json, manifest_to_json
from tests.recordings.trials import MANIFEST
from tests.refusals import raises_refusal


def test_a_manifest_comes_back_equal_and_a_key_that_a_later_version_added_is_passed_over() -> None:
    assert manifest_from_json(manifest_to_json(MANIFEST)) == MANIFEST
    grown = json.loads(manifest_to_json(MANIFEST)) | {"room_temperature_c": 21.5}
    assert manifest_from_json(json.dumps(grown)) == MANIFEST


TEXT = manifest_to_json(MANIFEST)
DEEP = '"effective_config":{"a":' + "[" * 99_999 + "]" * 99_999 + ","


@pytest.mark.parametrize(
    "text",
    [re.sub(r'"site":\s*"\w+",?', "", TEXT), "{", TEXT.replace('"effective_config":{', DEEP)],
    ids=["missing key", "no JSON", "nested too deep"],
)
def test_a_text_that_is_no_manifest_is_refused(text: str) -> None:
    assert text != TEXT
    with raises_refusal(RecordingCode.MANIFEST):
        manifest_from_json(text)


@pytest.mark.parametrize("name", ["../../hand", "C:hand", "a\\b", "ha\x00nd", "hand\n", "", "x" * 300])
def test_a_cuff_that_is_named_like_a_path_is_refused(name: str) -> None:
    changed = json.loads(manifest_to_json(MANIFEST))
    changed["cuff"]["name"] = name
    with raises_refusal(RecordingCode.MANIFEST):
        manifest_from_json(json.dumps(changed))


@pytest.mark.parametrize(
    ("key", "value"),
    [("start_utc_ns", 10**400), ("start_utc_ns", -1), ("repeat", 10**400), ("origin_s", "1e999"), ("test", ["static"])],
)
def test_a_figure_that_nothing_can_be_computed_with_is_refused(key: str, value: object) -> None:
    changed = json.loads(manifest_to_json(MANIFEST)) | {key: value}
    with raises_refusal(RecordingCode.MANIFEST):
        manifest_from_json(json.dumps(changed).replace('"1e999"', "1e999"))

"""The manifest survives its file, and what later versions add to it."""

from __future__ import annotations

import json

import pytest

from recordings.errors import RecordingError
from recordings.manifest import manifest_from_json, manifest_to_json
from tests.recordings.trials import MANIFEST


def test_a_manifest_comes_back_equal() -> None:
    assert manifest_from_json(manifest_to_json(MANIFEST)) == MANIFEST


def test_a_key_that_a_later_version_added_is_passed_over() -> None:
    grown = json.loads(manifest_to_json(MANIFEST)) | {"room_temperature_c": 21.5}
    assert manifest_from_json(json.dumps(grown)) == MANIFEST


def test_a_missing_key_is_named() -> None:
    shrunk = json.loads(manifest_to_json(MANIFEST))
    del shrunk["cuff"]["site"]
    with pytest.raises(RecordingError, match=r"at cuff\.site, field required"):
        manifest_from_json(json.dumps(shrunk))


def test_a_text_that_is_no_json_is_refused_in_a_sentence() -> None:
    with pytest.raises(RecordingError, match="the manifest cannot be read"):
        manifest_from_json("{")


@pytest.mark.parametrize("name", ["../../hand", "C:hand", "a\\b"])
def test_a_cuff_that_is_named_like_a_path_is_refused(name: str) -> None:
    changed = json.loads(manifest_to_json(MANIFEST))
    changed["cuff"]["name"] = name
    with pytest.raises(RecordingError, match="expected no path"):
        manifest_from_json(json.dumps(changed))

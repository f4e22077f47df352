"""Random input of the configuration and of `station info`, and what must hold for all of it.

This is a short run; benchmarks/fuzz.py runs longer.
"""

import contextlib
import io
import json
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st
from pydantic import BaseModel

from recordings.errors import RecordingError
from station.config import ConfigError, StationConfig, load_config, parse_config
from station.files.info import show_contents
from tests.drivers.test_fuzz import Target, run
from tests.recordings.test_fuzz import Change, changes_to_a_file, damaged_file, forged_file, forged_messages

_SECTIONS: dict[str, list[str]] = {
    name: list(field.annotation.model_fields)
    for name, field in StationConfig.model_fields.items()
    if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)
}
_values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=12), st.sampled_from(["daq", ""])),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
    max_leaves=8,
)
_sections = st.sampled_from(list(_SECTIONS)).flatmap(
    lambda name: st.tuples(
        st.just(name), st.dictionaries(st.sampled_from([*_SECTIONS[name], "unknown"]), _values, max_size=4)
    )
)
_cuffs = st.dictionaries(
    st.sampled_from(["waist", "hand", "x", ""]),
    st.dictionaries(st.sampled_from(["site", "anchor_markers", "cuff_markers", "mass_kg"]), _values, max_size=4),
    max_size=3,
)
_configurations = st.one_of(
    st.dictionaries(st.sampled_from([*StationConfig.model_fields, "unknown"]), _values, max_size=4),
    st.tuples(st.lists(_sections, max_size=3).map(dict), _cuffs).map(lambda both: {**both[0], "cuffs": both[1]}),
)
_files = st.one_of(st.binary(), st.text().map(lambda text: ("[daq]\ndevice = " + text).encode("utf-8", "replace")))


def _data_is_a_configuration_or_a_sentence(data: dict[str, Any]) -> None:
    try:
        config = parse_config(data, "station.toml")
    except ConfigError as error:
        assert "\n" not in str(error), str(error)
    else:
        assert parse_config(config.model_dump(mode="json"), "again").daq == config.daq


def _a_file_is_a_configuration_or_a_sentence(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "station.toml"
        path.write_bytes(content)
        try:
            load_config(path)
        except ConfigError as error:
            assert "\n" not in str(error), str(error)


def _a_file_is_shown_or_refused(changes: list[Change], messages: list[tuple[str, bytes]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for path in (damaged_file(changes, Path(folder)), forged_file(messages, Path(folder))):
            with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()):
                try:
                    assert show_contents(path, as_json=True) in (0, 3)
                except RecordingError as error:
                    assert "\n" not in str(error), str(error)
                else:
                    assert "sync_sentence" in json.loads(out.getvalue())


TARGETS = (
    Target(
        "info",
        st.tuples(changes_to_a_file, st.lists(forged_messages, max_size=12)),
        lambda both: _a_file_is_shown_or_refused(*both),
        0.25,
    ),
    Target("configuration", _configurations, _data_is_a_configuration_or_a_sentence, 0.5),
    Target("configuration file", _files, _a_file_is_a_configuration_or_a_sentence),
)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_any_configuration_is_used_or_refused_with_a_sentence(target: Target) -> None:
    assert run(target, 200) > 0

"""Laws of files that outlive a process: whole or absent, verified by hash, refused when they are something else."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fairlead.core.artifacts import (
    MANIFEST,
    SCHEMA,
    Manifest,
    append_jsonl,
    config_hash,
    read_json,
    read_jsonl,
    read_manifest,
    sha256,
    verify_files,
    write_atomic,
    write_json,
)
from fairlead.core.errors import ArtifactError

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(value=json_values)
def test_json_survives_the_round_trip(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    path = tmp_path_factory.mktemp("json") / "below" / "value.json"
    write_json(path, value)
    assert read_json(path) == value
    assert [child.name for child in path.parent.iterdir()] == ["value.json"]


@given(
    rows=st.lists(st.dictionaries(st.text(), st.integers(), max_size=3), min_size=1, max_size=4), cut=st.integers(1, 5)
)
def test_a_killed_writers_last_line_is_passed_over_and_no_other(
    tmp_path_factory: pytest.TempPathFactory, rows: list[dict[str, int]], cut: int
) -> None:
    path = tmp_path_factory.mktemp("jsonl") / "rows.jsonl"
    for row in rows:
        append_jsonl(path, row)
    assert list(read_jsonl(path)) == rows
    whole = path.read_bytes()
    last = whole[:-1].rfind(b"\n") + 1
    path.write_bytes(whole[: max(last, len(whole) - 1 - cut)])
    assert list(read_jsonl(path)) == rows[:-1]
    path.write_bytes(b'{"half": \n' + whole)
    with pytest.raises(ArtifactError, match="line 1"):
        list(read_jsonl(path))


def test_a_missing_jsonl_file_has_no_rows(tmp_path: Path) -> None:
    assert list(read_jsonl(tmp_path / "none.jsonl")) == []


WRITER = """
import sys
from pathlib import Path
from fairlead.core.artifacts import write_atomic
path, size = Path(sys.argv[1]), 1 << 20
for i in range(100_000):
    write_atomic(path, bytes([i % 256]) * size)
"""


def test_a_reader_never_sees_a_part_even_when_the_writer_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for _ in range(3):
        path.unlink(missing_ok=True)
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)])
        while not path.exists():
            assert writer.poll() is None
            time.sleep(0.001)
        seen, changes = b"", 0
        while changes < 60:
            content = path.read_bytes()
            assert len(content) == 1 << 20
            assert content == content[:1] * len(content)
            changes += content[:1] != seen
            seen = content[:1]
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        content = path.read_bytes()
        assert content == content[:1] * (1 << 20)
    write_atomic(path, "whole")
    assert [child.name for child in tmp_path.iterdir()] == ["file"]


@given(config=st.dictionaries(st.text(), st.integers(), max_size=4))
def test_a_config_hash_does_not_depend_on_order_and_does_on_content(config: dict[str, int]) -> None:
    assert config_hash(config) == config_hash(dict(reversed(config.items())))
    assert config_hash(config) != config_hash(config | {"one more key": 1})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.bin").write_bytes(b"abc")
    files = {"a.bin": sha256(tmp_path / "a.bin")}
    Manifest("dataset", {"n": 1}, 7, files, {"model": "0" * 64}, {"count": 3}, 1.25).write(tmp_path)
    return tmp_path


def test_a_manifest_survives_the_round_trip_and_says_what_made_it(folder: Path) -> None:
    manifest = read_manifest(folder, "dataset")
    assert (manifest.config, manifest.seed, manifest.extra) == ({"n": 1}, 7, {"count": 3})
    verify_files(folder, manifest)
    written = read_json(folder / MANIFEST)
    assert {"command", "git", "versions", "hardware", "schema"} <= set(written)


def test_a_folder_that_is_something_else_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="'dataset'; a 'model' is needed"):
        read_manifest(folder, "model")
    with pytest.raises(ArtifactError, match="no manifest"):
        read_manifest(tmp_path / "nowhere", "dataset")
    written = read_json(folder / MANIFEST)
    write_json(folder / MANIFEST, written | {"schema": SCHEMA + 1})
    with pytest.raises(ArtifactError, match=f"schema {SCHEMA + 1}; this version reads {SCHEMA}"):
        read_manifest(folder, "dataset")
    (folder / MANIFEST).write_text(json.dumps(written)[:-20])
    with pytest.raises(ArtifactError, match="not valid JSON"):
        read_manifest(folder, "dataset")


def test_a_changed_or_missing_file_is_named(folder: Path) -> None:
    manifest = read_manifest(folder, "dataset")
    (folder / "a.bin").write_bytes(b"abd")
    with pytest.raises(ArtifactError, match=r"a\.bin: damaged"):
        verify_files(folder, manifest)
    (folder / "a.bin").unlink()
    with pytest.raises(ArtifactError, match=r"a\.bin: missing"):
        verify_files(folder, manifest)


@pytest.mark.parametrize("value", [[], {"schema": SCHEMA, "kind": "dataset"}, 3])
def test_a_manifest_without_its_keys_is_a_users_mistake(folder: Path, value: object) -> None:
    write_json(folder / MANIFEST, value)
    with pytest.raises(ArtifactError, match=r"manifest\.json"):
        read_manifest(folder, "dataset")

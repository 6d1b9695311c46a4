"""Files that outlive a process: written whole or not at all, explained by a manifest, verified by hash."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any, cast

from fairlead.core.cores import cores
from fairlead.core.errors import ArtifactError

MANIFEST = "manifest.json"
SCHEMA = 1
_LIBRARIES = ("mujoco", "numpy", "torch", "ompl", "pyarrow", "scipy")


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def config_hash(config: Mapping[str, Any]) -> str:
    """A short hash of a configuration, independent of the order of its keys."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:16]


def write_atomic(path: Path, content: bytes | str) -> None:
    """Write a file so that a reader sees the old content or the new one, never a part: temporary, sync, rename."""
    if path.is_dir():
        raise ArtifactError(path, "is a folder; the name of a file is needed")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically, with sorted keys and a newline at the end."""
    write_atomic(path, json.dumps(value, indent=1, sort_keys=True) + "\n")


def read_json(path: Path) -> Any:
    """Read JSON; a missing or broken file is an ArtifactError that names it."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise ArtifactError(path, "no such file") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ArtifactError(path, f"not valid JSON ({error})") from None


def append_jsonl(path: Path, row: Mapping[str, Any]) -> None:
    """Append one object to a JSON-lines file and sync it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        file.write(json.dumps(row, sort_keys=True) + "\n")
        file.flush()
        os.fsync(file.fileno())


def read_jsonl(path: Path) -> Iterator[dict[str, Any]]:
    """Read a JSON-lines file. An unfinished last line (a killed writer) is passed over; any other is an error."""
    lines = path.read_text().split("\n") if path.exists() else []
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            if number < len(lines):
                raise ArtifactError(path, f"line {number} is not valid JSON") from None


@contextmanager
def alone(folder: Path) -> Generator[None]:
    """Nobody else writes into this folder meanwhile; ArtifactError where somebody does. It is created where missing."""
    folder.mkdir(parents=True, exist_ok=True)
    held = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            problem = "another process is at work there; wait for it, or choose another folder"
            raise ArtifactError(folder, problem) from None
        yield
    finally:
        os.close(held)


def git_revision() -> str:
    """The revision of the code that runs, when it runs from a checkout."""
    try:
        run = subprocess.run(
            ["git", "describe", "--always", "--dirty"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return run.stdout.strip()


def provenance() -> dict[str, Any]:
    """What made an artifact: command, revision, versions, hardware."""
    versions = {"python": platform.python_version()}
    for name in ("fairlead", *_LIBRARIES):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "missing"
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "git": git_revision(),
        "versions": versions,
        "hardware": {"machine": platform.machine(), "cores": cores()},
    }


@dataclass(frozen=True)
class Manifest:
    """What a folder is. `kind` is one of dataset, model, trials, evidence, sensitivity, report.

    files maps a relative name to its SHA-256; inputs maps a name to the hash of the manifest that was read.
    """

    kind: str
    config: dict[str, Any]
    seed: int
    files: dict[str, str]
    inputs: dict[str, str]
    extra: dict[str, Any]
    wall_s: float = 0.0

    def write(self, folder: Path) -> None:
        """Write `manifest.json`, last of all files."""
        write_json(
            folder / MANIFEST,
            {
                "schema": SCHEMA,
                "kind": self.kind,
                "config": self.config,
                "seed": self.seed,
                "files": self.files,
                "inputs": self.inputs,
                "extra": self.extra,
                "wall_s": round(self.wall_s, 1),
                **provenance(),
            },
        )


def read_manifest(folder: Path, kind: str) -> Manifest:
    """Read a folder's manifest; refuse a folder without one, of another kind or of another schema."""
    path = folder / MANIFEST
    if not path.exists():
        raise ArtifactError(folder, f"no {MANIFEST}: not a finished {kind} (resume or run the stage that makes it)")
    value = read_json(path)
    found = cast(dict[str, Any], value) if isinstance(value, dict) else {}
    if found.get("schema") != SCHEMA:
        raise ArtifactError(path, f"schema {found.get('schema')!r}; this version reads {SCHEMA}")
    if found.get("kind") != kind:
        raise ArtifactError(path, f"this is a {found.get('kind')!r}; a {kind!r} is needed here")
    keys = [field.name for field in fields(Manifest)]
    if missing := [key for key in keys if key not in found]:
        raise ArtifactError(path, f"missing: {', '.join(missing)}")
    return Manifest(**{key: found[key] for key in keys})


def verify_files(folder: Path, manifest: Manifest) -> None:
    """Check the hash of every file that the manifest lists; name the first that is missing or differs."""
    for name, expected in manifest.files.items():
        path = folder / name
        if not path.exists():
            raise ArtifactError(path, "missing, though the manifest lists it")
        if sha256(path) != expected:
            raise ArtifactError(path, "damaged: its SHA-256 differs from the manifest's")

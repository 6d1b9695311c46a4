"""Collection in the simulated dragging world: the same bytes at any number of threads, and after an interruption."""

from __future__ import annotations

from pathlib import Path

import pytest

from fairlead.core.artifacts import MANIFEST, sha256
from fairlead.data.collect import CollectConfig, collect
from fairlead.data.verify import verify
from fairlead.scenarios.registry import scenario


def contents(folder: Path) -> dict[str, str]:
    return {path.name: sha256(path) for path in folder.iterdir() if path.name != MANIFEST}


@pytest.mark.parametrize("phase", [1, 2])
def test_neither_threads_nor_an_interruption_change_a_byte(tmp_path: Path, phase: int) -> None:
    config = CollectConfig(phase, trajectories=18, seed=3, lanes=8, steps=3, obstacles_every=3)
    world = scenario("dragging")
    collect(world, config, tmp_path / "one", threads=1)
    collect(world, config, tmp_path / "two", threads=2)

    def interrupt(_: int) -> None:
        if (tmp_path / "three" / "shard-00000.parquet").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        collect(world, config, tmp_path / "three", threads=2, advance=interrupt)
    collect(world, config, tmp_path / "three", threads=1)
    assert contents(tmp_path / "one") == contents(tmp_path / "two") == contents(tmp_path / "three")
    assert verify(tmp_path / "one")["trajectories"] == 18

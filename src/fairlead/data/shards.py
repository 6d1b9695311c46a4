"""One Parquet shard: the same trajectory number of every lane, one row a transition.

Columns have the names of LeRobot's dataset format (v3) where it has one. The bytes depend on the content alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float, Int, Shaped

from fairlead.core.errors import ArtifactError
from fairlead.core.layout import StateLayout
from fairlead.core.records import ActionOutcome

SPLITS = ("train", "validation", "test")
_LABELS = np.array([outcome.label for outcome in ActionOutcome])


def split_of(lane: int) -> str:
    """The split of a lane, fixed before anything is recorded: of every eight lanes 6 train, 1 validation, 1 test.

    A lane is a chain of trajectories that share obstacles and pass the rope on, so neighbours never part.
    """
    return {6: "validation", 7: "test"}.get(lane % 8, "train")


def shard_name(index: int) -> str:
    """File name of a shard."""
    return f"shard-{index:05d}.parquet"


def schema(layout: StateLayout) -> pa.Schema:
    """The columns of every shard."""
    state, action = pa.list_(pa.float32(), layout.state_size), pa.list_(pa.float32(), layout.action_size)
    return pa.schema(
        {
            "episode_index": pa.int64(),
            "frame_index": pa.int64(),
            "timestamp": pa.float32(),
            "seconds": pa.float32(),
            "observation.state": state,
            "action": action,
            "next.observation.state": state,
            "outcome": pa.string(),
            "lane": pa.int64(),
            "scene_index": pa.int64(),
            "split": pa.string(),
        }
    )


@dataclass(frozen=True)
class Shard:
    """Trajectory number `index` of each lane in `lane` (those that diverged are left out).

    states and actions [m] as recorded (float32); seconds: simulated time of each action; outcomes: numbers of
    `ActionOutcome`; scene: index into the dataset's scenes; episode: unique in the dataset; split: of SPLITS.
    """

    episode: Int[np.ndarray, " lane"]
    lane: Int[np.ndarray, " lane"]
    scene: Int[np.ndarray, " lane"]
    split: Shaped[np.ndarray, " lane"]
    states: Float[np.ndarray, "lane steps_and_one state"]
    actions: Float[np.ndarray, "lane steps action"]
    seconds: Float[np.ndarray, "lane steps"]
    outcomes: Int[np.ndarray, "lane steps"]

    def to_bytes(self, layout: StateLayout) -> bytes:
        """The shard as a Parquet file."""
        lanes, steps = self.outcomes.shape
        started = np.cumsum(self.seconds, axis=1) - self.seconds
        columns = {
            "episode_index": np.repeat(self.episode, steps),
            "frame_index": np.tile(np.arange(steps), lanes),
            "timestamp": started.ravel(),
            "seconds": self.seconds.ravel(),
            "observation.state": self.states[:, :-1],
            "action": self.actions,
            "next.observation.state": self.states[:, 1:],
            "outcome": _LABELS[self.outcomes.ravel()],
            "lane": np.repeat(self.lane, steps),
            "scene_index": np.repeat(self.scene, steps),
            "split": np.repeat(self.split, steps),
        }
        arrays = [_array(columns[field.name], field.type) for field in schema(layout)]
        sink = pa.BufferOutputStream()
        pq.write_table(
            pa.Table.from_arrays(arrays, schema=schema(layout)), sink, compression="zstd", version="2.6",
            row_group_size=1 << 20,
        )  # fmt: skip
        return sink.getvalue().to_pybytes()


def _array(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(pa.array(values.astype(np.float32).ravel()), kind.list_size)
    return pa.array(values, type=kind)


def read_shard(path: Path, layout: StateLayout, steps: int) -> Shard:
    """Read a shard whose trajectories have `steps` actions.

    Raises:
        ArtifactError: the file is missing, truncated, or its columns or rows are not a shard's.
    """
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise ArtifactError(path, f"not a readable shard ({str(error).splitlines()[0]})") from None
    if not table.schema.equals(schema(layout)):
        raise ArtifactError(path, f"its columns are not a shard's; needed: {', '.join(schema(layout).names)}")

    def column(name: str) -> np.ndarray:
        values = table[name].combine_chunks()
        if pa.types.is_fixed_size_list(values.type):
            return values.flatten().to_numpy().reshape(-1, steps, values.type.list_size)
        return values.to_numpy(zero_copy_only=False).reshape(-1, steps)

    if any(values.null_count for values in table.columns):
        raise ArtifactError(path, "a value is missing")
    if table.num_rows % steps or (column("frame_index") != np.arange(steps)).any():
        raise ArtifactError(path, f"its rows are not whole trajectories of {steps} steps")
    before, after = column("observation.state"), column("next.observation.state")
    if not np.array_equal(after[:, :-1], before[:, 1:], equal_nan=True):
        raise ArtifactError(path, "a next state is not the state of the next row")
    index = {label: i for i, label in enumerate(_LABELS)}
    for name, allowed in (("outcome", tuple(index)), ("split", SPLITS)):
        if unknown := set(column(name).ravel()) - set(allowed):
            raise ArtifactError(path, f"unknown {name} {sorted(unknown)[0]!r}; allowed: {', '.join(allowed)}")
    return Shard(
        episode=column("episode_index")[:, 0],
        lane=column("lane")[:, 0],
        scene=column("scene_index")[:, 0],
        split=column("split")[:, 0],
        states=np.concatenate([before, after[:, -1:]], axis=1),
        actions=column("action"),
        seconds=column("seconds"),
        outcomes=np.vectorize(index.__getitem__, otypes=[np.int64])(column("outcome")),
    )

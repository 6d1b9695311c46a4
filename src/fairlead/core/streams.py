"""Named random streams derived from one seed. Nothing in Fairlead draws from a global generator."""

from __future__ import annotations

import hashlib

import numpy as np


def stream_seed(seed: int, *names: str | int) -> int:
    """A 63-bit seed for the stream called `names` under `seed`; the same on every machine."""
    digest = hashlib.sha256("/".join([str(seed), *map(str, names)]).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """The random stream called `names` under `seed`, independent of every other name."""
    return np.random.default_rng(stream_seed(seed, *names))

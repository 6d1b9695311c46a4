"""The trials of three seeds of training as one set, written to seeds.json: a scene counts once, with the mean of all.

Run here, with Fairlead installed: python seeds.py
"""

from pathlib import Path

from fairlead.core.artifacts import read_jsonl, write_json
from fairlead.evaluation.summary import summarise

HERE = Path(__file__).parent
OF_TRAINING_SEED = {0: "authors-180", 1: "seed-1/trials/authors", 2: "seed-2/trials/authors"}
METHODS = ("trust", "trust-sdf", "accept-all", "full-dynamics", "collision-check", "spread-threshold")

rows = [
    {**row, "seed": 1000 * training + row["seed"]}
    for training, folder in OF_TRAINING_SEED.items()
    for row in read_jsonl(HERE / folder / "trials.jsonl")
]
write_json(HERE / "seeds.json", {of: summarise(rows, METHODS, 0, of) for of in ("trust", "trust-sdf")})

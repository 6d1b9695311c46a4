"""All methods as they are now, on the authors' and the hard scenes, written to now.json.

The check's rows are of contact-*, full dynamics on the authors' scenes of fast-authors-3, the others of best-*.
Run here, with Fairlead installed: python now.py
"""

from pathlib import Path

from fairlead.core.artifacts import read_jsonl, write_json
from fairlead.evaluation.summary import summarise

HERE = Path(__file__).parent
METHODS = {
    "authors": {
        "trust-sdf": "best-authors-3",
        "accept-all": "best-authors-3",
        "full-dynamics": "fast-authors-3",
        "collision-check": "contact-authors-3",
    },
    "hard": {
        "trust-sdf": "best-hard-3",
        "accept-all": "best-hard-3",
        "full-dynamics": "best-hard-3",
        "collision-check": "contact-hard-3",
    },
}


def summary(folders: dict[str, str]) -> dict:
    """Of the rows of each method in its folder."""
    found = [
        row
        for method, folder in folders.items()
        for row in read_jsonl(HERE / folder / "trials.jsonl")
        if row["method"] == method
    ]
    return summarise(found, tuple(folders), 0, "trust-sdf")


write_json(HERE / "now.json", {scenes: summary(folders) for scenes, folders in METHODS.items()})

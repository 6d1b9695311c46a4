"""The collision check as it is now beside the other methods of best-authors-3 and best-hard-3, written to check.json.

Run here, with Fairlead installed: python check.py
"""

from pathlib import Path

from fairlead.core.artifacts import read_jsonl, write_json
from fairlead.evaluation.summary import summarise

HERE, CHECK = Path(__file__).parent, "collision-check"
METHODS = ("trust-sdf", "accept-all", "full-dynamics", CHECK)


def rows(scenes: str) -> list:
    """All methods' rows, the check's from the folder of its own."""
    others = [row for row in read_jsonl(HERE / f"best-{scenes}-3" / "trials.jsonl") if row["method"] != CHECK]
    return others + list(read_jsonl(HERE / f"contact-{scenes}-3" / "trials.jsonl"))


write_json(HERE / "check.json", {of: summarise(rows(of), METHODS, 0, "trust-sdf") for of in ("authors", "hard")})

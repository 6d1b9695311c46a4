"""Arms of one's own, from an MJCF file: two of six joints each take a rope's ends over a table.

The file needs a site at each arm's fingertips (z out of the hand), a range for every joint, capsules or spheres where
the arms may collide, and a keyframe `home` above the work with the tools pointing down.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fairlead.core.records import ActionOutcome
from fairlead.geometry.shapes import Box
from fairlead.scenarios.arms import Arms

TABLE = Box((0.8, 1.5, 0.12), (0.8, 0.0, 0.565))
POST = Box((0.05, 0.05, 0.3), (0.75, 0.0, 0.775))


def own_arms() -> Arms:
    """The arms of the file beside this one; joints turn at most 2 rad/s."""
    return Arms.from_mjcf(Path(__file__).with_suffix(".xml"), ("left_grip", "right_grip"), [2.0] * 6)


def main() -> None:
    """Ask for two motions, the second through a post, and say how they end."""
    arms = own_arms()
    grippers = np.array([[[0.75, 0.2, 0.8], [0.75, -0.2, 0.8]]] * 2)
    targets = grippers + np.array([[[0.0, 0.0, 0.1], [0.0, 0.0, 0.1]], [[0.0, -0.2, 0.0], [0.0, 0.0, 0.1]]])
    joints, reached = arms.grasp(grippers)
    path = arms.follow(joints, grippers, targets, [[TABLE, POST]] * 2)
    for row in range(2):
        outcome = tuple(ActionOutcome)[path.outcomes[row]]
        print(
            f"grasped: {reached[row]}; {path.reached[row]} of 6 parts in {path.seconds[row]:.2f} s: {outcome.sentence}"
        )


if __name__ == "__main__":
    main()

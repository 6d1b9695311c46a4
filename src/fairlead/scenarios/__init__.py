"""The simulated worlds. The only package that imports MuJoCo."""

import os
import sys

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # MuJoCo picks its renderer when it is imported, and its default needs a screen.
    os.environ.setdefault("MUJOCO_GL", "egl")

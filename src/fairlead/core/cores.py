"""How many processor cores this process may use, and of what."""

from __future__ import annotations

import os
import platform
from pathlib import Path

CPU_MAX = Path("/sys/fs/cgroup/cpu.max")
"""Linux, in a container: how many microseconds of processor time it may take in how many, or `max` and the latter."""


def cores() -> int:
    """Those it is bound to, where the system tells, else those of the machine; no more than a container's share."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota, period = CPU_MAX.read_text().split() if CPU_MAX.exists() else ("max", "")
    return bound if quota == "max" else max(1, min(bound, int(quota) // int(period)))


def machine() -> str:
    """The cores and their model, where the system tells it; else their architecture."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return f"{cores()} x {next(models, platform.processor() or platform.machine())}"

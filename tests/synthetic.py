"""Made-up trial rows and scenes, for tests of what reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

RATES = {"trust": 0.92, "trust-sdf": 0.94, "accept-all": 0.7, "full-dynamics": 0.3, "collision-check": 0.9}


def row(method: str, scene: str, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """One trial of a method that succeeds at its rate."""
    success = bool(rng.random() < RATES[method])
    planning, execution = float(rng.gamma(2, 0.6)), float(rng.gamma(4, 4.0))
    return {
        "scenario": "dragging",
        "scenes": "made-up",
        "scene": scene,
        "method": method,
        "seed": seed,
        "success": success,
        "error_m": float(rng.uniform(0.01, 0.05) if success else 0.05 + rng.exponential(0.4)),
        "planning_s": planning,
        "execution_s": execution,
        "extensions": int(rng.integers(200, 20_000)),
        "plans": int(rng.integers(1, 8)),
        "recovery_actions": 0,
        "actions": int(execution),
        "action_outcomes": {"target": int(execution) - 1, "timeout": 1},
        "outcome": "goal" if success else str(rng.choice(["budget", "budget", "stuck"])),
        "first_plan_success": bool(success and rng.random() < 0.5),
        "first_plan_error_m": float(rng.exponential(0.1)),
        "times_stuck": int(rng.random() < 0.1),
        "reached_at_s": planning + execution if success else None,
        "budget": "seconds=60",
        "protocol": "fair",
    }


def rows(scenes: int = 20, seeds: int = 2, methods: tuple[str, ...] = tuple(RATES)) -> list[dict[str, Any]]:
    """Trials of every method on every scene."""
    rng = np.random.default_rng(0)
    return [row(m, f"scene-{s:03d}", seed, rng) for m in methods for s in range(scenes) for seed in range(seeds)]


def scene(name: str, rng: np.random.Generator) -> dict[str, Any]:
    """A scene in the format of scene files."""
    heading = np.cumsum(rng.uniform(-0.5, 0.5, 10))
    steps = 0.05 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=-1)
    rope = np.cumsum(steps, axis=0) + np.append(rng.uniform(-0.4, 0.2, 2), 0.02)
    obstacles = []
    for i in range(6):
        yaw = rng.uniform(-np.pi, np.pi)
        box = {
            "size": [0.25, 0.25, 0.25],
            "position": [*rng.uniform(-0.8, 0.8, 2), 0.125],
            "quaternion_xyzw": [0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))],
        }
        obstacles.append({"name": f"box{i}", "boxes": [box]})
    return {
        "name": name,
        "obstacles": obstacles,
        "grippers": {"gripper": [*(rope[-1] + 0.5 * steps[-1])[:2], 0.02]},
        "rope": rope.tolist(),
        "goal": {"target": "tail", "position": [*rng.uniform(-0.7, 0.7, 2), 0.02], "radius": 0.05},
    }

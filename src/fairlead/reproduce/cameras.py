"""The camera that videos are seen through: the renderer, where a top view would hide what matters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from fairlead.core.errors import FairleadError
from fairlead.report.stage import Camera
from fairlead.scenarios.other_world import Differences, with_arms_of
from fairlead.scenarios.registry import scenario as find_scenario
from fairlead.scenarios.scene_files import scene_from


@contextmanager
def camera(
    config: Mapping[str, Any], scene: Mapping[str, Any], side: int, shadows: bool = False
) -> Iterator[Camera | None]:
    """A renderer of the scene with that side [pixels], with the arms that carry out trials of the configuration.

    None where everything moves in a plane among things all alike, which is seen best from above, and where nothing can
    be rendered: a video from above is better than none.
    """
    differences = config.get("differences")
    world = with_arms_of(find_scenario(config["scenario"]), Differences.parse(differences) if differences else None)
    placed = scene_from(scene, world.layout)
    with ExitStack() as opened:
        found = None
        if not world.sampler.planar or world.colours:
            with suppress(FairleadError):
                found = opened.enter_context(world.renderer(placed, side, side, shadows))
        yield found

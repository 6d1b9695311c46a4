"""`fairlead doctor`."""

from __future__ import annotations

import os
import platform
import shutil
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from fairlead.cli.output import show
from fairlead.core.cores import cores
from fairlead.core.errors import FairleadError

ENGINES = ("numpy", "scipy", "mujoco", "torch", "ompl", "pyarrow", "safetensors", "matplotlib", "imageio-ffmpeg")
MODULES = {"imageio-ffmpeg": "imageio_ffmpeg"}


def _library(name: str) -> str:
    try:
        import_module(MODULES.get(name, name))
        return metadata.version(name)
    except (ImportError, metadata.PackageNotFoundError) as error:
        return f"missing ({error}): pip install {name}"


def _rendering() -> str:
    from fairlead.core.streams import stream
    from fairlead.scenarios.registry import scenario
    from fairlead.scenarios.render import SceneRenderer

    world = scenario("dragging")
    try:
        with SceneRenderer(world.backdrop(), world.layout, world.rope_radius, (), (), 32, 32) as renderer:
            renderer.frame(world.random_start(stream(0, "doctor")))
    except FairleadError as error:
        reason = str(error).splitlines()[0]
        return f"missing ({reason}): install libegl1 and set MUJOCO_GL=egl, or libosmesa6 and MUJOCO_GL=osmesa"
    return f"works (MUJOCO_GL={os.environ.get('MUJOCO_GL', 'default')})"


def _video() -> str:
    import imageio_ffmpeg

    try:
        return Path(imageio_ffmpeg.get_ffmpeg_exe()).name
    except RuntimeError as error:
        return f"missing ({str(error).splitlines()[0]}): pip install --force-reinstall imageio-ffmpeg"


def examine() -> dict[str, Any]:
    """What is here: libraries, rendering, video, cores, disk. A value that begins with 'missing' is a problem."""
    import_module("fairlead.scenarios")  # chooses MuJoCo's renderer, so before MuJoCo itself
    found: dict[str, Any] = {"python": platform.python_version(), **{name: _library(name) for name in ENGINES}}
    for key, needs, probe in (("rendering", "mujoco", _rendering), ("video", "imageio-ffmpeg", _video)):
        found[key] = f"missing: it needs {needs}" if found[needs].startswith("missing") else probe()
    found["graphics card"] = "present" if shutil.which("nvidia-smi") else "none (not needed)"
    found["cores"] = cores()
    found["free disk (GB)"] = round(shutil.disk_usage(Path.cwd()).free / 1e9, 1)
    return found


@dataclass(frozen=True)
class Command:
    """What this machine has; what is missing and how to get it."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> None:
        """Print the findings; a missing part is an error."""
        found = examine()
        show(found, self.json)
        missing = [key for key, value in found.items() if str(value).startswith("missing")]
        if missing:
            raise FairleadError(f"missing: {', '.join(missing)}; the lines above say how to get them")

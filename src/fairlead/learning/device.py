"""Where networks compute: in training on a graphics card, where there is one; in planning on the processor.

A plan asks about few transitions at a time, and trials run in many processes: a processor is faster at that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from fairlead.core.streams import stream_seed

CPU = torch.device("cpu")
N = TypeVar("N", bound=nn.Module)


def seeded(build: Callable[[], N], seed: int, kind: str) -> N:
    """A network whose weights derive from `seed`, in evaluation mode."""
    with torch.random.fork_rng(devices=[]):  # torch's layers draw from the global generator: put it back afterwards
        torch.manual_seed(stream_seed(seed, kind, "weights"))
        return build().eval()


def training_device() -> torch.device:
    """The graphics card that CUDA shows first, or else the processor.

    A card computes in single precision like the processor that will plan, not in the TensorFloat-32 of its default.
    """
    torch.backends.cudnn.allow_tf32 = False
    return torch.device("cuda") if torch.cuda.is_available() else CPU


def device_name(device: torch.device) -> str:
    """What a manifest says of it."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else device.type


def device_of(module: nn.Module) -> torch.device:
    """Where a module's weights are."""
    return next(module.parameters()).device


def beside(module: nn.Module, array: np.ndarray) -> Tensor:
    """An array as a tensor where the module's weights are."""
    return torch.from_numpy(array).to(device_of(module))

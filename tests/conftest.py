"""Shapes and types are checked at run time in tests; the authors' scenes are found, or their tests say why not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

os.environ.setdefault("OMP_NUM_THREADS", "1")  # files of tests run side by side, two at a time: a core for each

CHECKED = ("core", "geometry", "planning", "execution")
install_import_hook([f"fairlead.{package}" for package in CHECKED], "typechecker.check")

settings.register_profile("thorough", deadline=None, max_examples=500)
settings.register_profile("quick", deadline=None, max_examples=25, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))


@pytest.fixture
def authors_scenes() -> Path:
    """The folder of the authors' scenes; they are not part of the repository."""
    from fairlead.evaluation.shipped import authors_folder  # not before types are checked

    folder = authors_folder()
    if not folder.is_dir():
        pytest.skip(f"the authors' scenes are not at {folder}; set FAIRLEAD_AUTHORS_SCENES to their folder")
    return folder

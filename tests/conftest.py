"""Fixtures shared by the whole suite."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured inputs beside the repository; users do not have it, so its absence skips."""
    if not (SHARED / "data").is_dir():
        pytest.skip(f"measured inputs are not here ({SHARED.name}/data beside the repository)")
    return SHARED / "data"


@pytest.fixture(scope="session")
def shared_tools(shared_data: Path) -> Path:
    """Scripts beside the repository, among them the MERL reconstructor."""
    return SHARED / "tools"

"""Files of a bundle, as a vandal finds them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the material.json of a bundle."""
    file = path / "material.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))


def stored(path: Path, name: str = "table") -> Path:
    """File of an image."""
    return path / json.loads((path / "material.json").read_text())["images"][name]["file"]

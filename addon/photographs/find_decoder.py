"""Which decoder reads photographs besides our own readers: Blender's, where there is one."""

from __future__ import annotations

import importlib
import sys
from typing import Any


def blender_decoder() -> Any:
    """Blender's own reading of photographs, None where there is no Blender."""
    if sys.modules.get("bpy") is None:
        return None
    return importlib.import_module(".blender_decoder", __package__).decode

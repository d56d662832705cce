"""The command line inside Blender: `blender --background --command measured_materials ...`."""

from __future__ import annotations

from typing import Any

import bpy

_registered: list[Any] = []


def _execute(arguments: list[str]) -> int:
    # Imported here so that starting Blender does not wait for it.
    from .main import main

    return main(arguments)


def register() -> None:
    """Called by `addon.register`."""
    # The identifier stays this one in every extension repository, whatever the package is called there.
    _registered.append(bpy.utils.register_cli_command("measured_materials", _execute))


def unregister() -> None:
    """Called by `addon.unregister`."""
    while _registered:
        bpy.utils.unregister_cli_command(_registered.pop())

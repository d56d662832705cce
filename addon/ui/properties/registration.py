"""Registering a group of properties that materials have."""

from __future__ import annotations

from collections.abc import Callable

import bpy


def registration(group: type[bpy.types.PropertyGroup], name: str) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that give every material a group of properties of this name, and that take it away."""

    def register() -> None:
        bpy.utils.register_class(group)
        setattr(bpy.types.Material, name, bpy.props.PointerProperty(type=group))

    def unregister() -> None:
        delattr(bpy.types.Material, name)
        bpy.utils.unregister_class(group)

    return register, unregister

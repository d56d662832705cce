"""Choices of Blender properties, with the words that stand for them."""

from __future__ import annotations

from typing import Any

import bpy


def enum(name: str, description: str, choices: tuple[str, ...], words: Any, usual: object, **options: Any) -> Any:
    """A choice with what `words` say of each item: what it is called and does. Without words it is called as it is."""
    items = [(choice, *words.get(choice, (choice.capitalize(), ""))) for choice in choices]
    return bpy.props.EnumProperty(name=name, description=description, items=items, default=str(usual), **options)

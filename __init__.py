"""Measured Materials: measured BRDFs and photographed swatches as path-traced Cycles materials."""


def register() -> None:
    """Called by Blender; only from here on is bpy imported."""
    from .addon import register

    register()


def unregister() -> None:
    """Called by Blender."""
    from .addon import unregister

    unregister()

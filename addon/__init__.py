"""Registration with Blender, operators, panels and the command line."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

# In the order of registration: a class comes after those that it refers to. Each module has register() and
# unregister(); they are imported only then, because they need bpy and the command line does not.
_MODULES = (
    "bake_properties",
    "arc_properties",
    "lighting_properties",
    "quality_properties",
    "import_operator",
    "lamps",
    "arc_operator",
    "bake_operator",
    "fit_operator",
    "panel",
    "check_operator",
    "cosine_lobe_operator",
    "command",
)


def register() -> None:
    """Register everything, or, when a part fails, nothing, and let its exception out."""
    done: list[ModuleType] = []
    try:
        for name in _MODULES:
            module = import_module(f".{name}", __package__)
            module.register()
            done.append(module)
    except BaseException:
        for module in reversed(done):
            module.unregister()
        raise


def unregister() -> None:
    """Undo `register`, last first."""
    for name in reversed(_MODULES):
        import_module(f".{name}", __package__).unregister()

"""Measured Materials: measured BRDFs and photographed swatches as path-traced Cycles materials."""


def register() -> None:
    """Called by Blender; only from here on is bpy imported."""
    from .addon import register

    register()


class glTF2ExportUserExtension:  # the name that Blender's exporter looks for
    """What the exporter of glTF asks about each material."""

    def gather_material_hook(self, written: object, material: object, _settings: object) -> None:
        """Called with glTF's material and Blender's."""
        from .addon.exports.gltf import without_glow

        without_glow(written, material)


def glTF2_pre_export_callback(_settings: object) -> None:
    """Called by the exporter before it looks at anything."""
    from .addon.exports.gltf import begin

    begin()


def glTF2_post_export_callback(_settings: object) -> None:
    """Called by the exporter when the file is written."""
    from .addon.exports.gltf import end

    end()


def unregister() -> None:
    """Called by Blender."""
    from .addon import unregister

    unregister()

"""Which of a bundle's images each mode is built of."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.data_image import LoadedBundle, bundle_images
from measured_materials.nodes.exported_look import Look, exported_closure, look_of, show_to_exporters
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Paint whose residual carries light."""
    paint = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    settings = BakeSettings(resolution=16, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
    return read_bundle(bake_source(paint, tmp_path_factory.mktemp("paint") / "paint", settings).path)


@pytest.mark.parametrize("mode", MODES)
def test_what_a_mode_is_built_of_is_known(bundle: Bundle, mode: str) -> None:
    """Before it is: the builder asks for these images and no others, where the scene calls for all there is."""
    record, load = BrdfRecord.read(bundle), bundle_images(bundle, "paint")
    asked = set()

    def noted(name: str) -> bpy.types.Image:
        asked.add(name)
        return load(name)

    build_material(record, mode=mode, images=noted, lamps=lamp_image(), lamp_share=True)
    assert asked == set(record.images_of(mode))


def test_a_kept_texture_without_its_file_is_told(bundle: Bundle, tmp_path: Path) -> None:
    """And what exporters see of a material whose gloss cannot be read is not made matte."""
    material = build_material(bundle)
    gloss = exported_closure(material.node_tree).inputs["Metallic"].default_value
    assert gloss > 0.1
    lost = bpy.data.images.new("lost", 1, 1)
    lost.source, lost.filepath = "FILE", str(tmp_path / "gone.exr")
    loaded = LoadedBundle(bundle.path, bundle.material, dict.fromkeys(bundle.material["images"], lost))
    with pytest.raises(BakeError, match="the file of the material's texture preview_weights is gone or damaged"):
        loaded.load("preview_weights")
    look = look_of(BrdfRecord.read(loaded))
    assert not look.known
    show_to_exporters(material.node_tree, look)
    assert exported_closure(material.node_tree).inputs["Metallic"].default_value == gloss
    show_to_exporters(material.node_tree, Look(look.colour))
    assert exported_closure(material.node_tree).inputs["Metallic"].default_value == 0

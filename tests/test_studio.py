"""The built-in studio, its renders and the contact sheets."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from measured_materials.addon.rendering.contact_sheet import Cell, to_display, write_png, write_sheet
from measured_materials.addon.studio import studio, studio_meshes
from measured_materials.bake.errors import BakeError
from support import monte_carlo
from support.scenes import diffuse_material, furnace, lit_sphere, principled_material

COLLECTIONS = "scenes", "objects", "meshes", "materials", "worlds", "lights", "cameras", "images", "node_groups"


def datablocks() -> dict[str, set[str]]:
    # Blender makes the image "Render Result" with the first render of a session and keeps it.
    return {name: {block.name for block in getattr(bpy.data, name)} - {"Render Result"} for name in COLLECTIONS}


@pytest.fixture(autouse=True, scope="module")
def nothing_left_over() -> None:
    """Aimed materials of other tests get other groups by every scene's lamps."""
    for name in ("materials", "node_groups"):
        bpy.data.batch_remove(set(getattr(bpy.data, name)))


def image_pixels(path: Path) -> np.ndarray:
    """(H, W, 3) of a PNG in [0, 1], as encoded in the file, row 0 on top."""
    image = bpy.data.images.load(str(path), check_existing=False)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels


@pytest.mark.parametrize("shape", ["ball", "sphere"])
def test_studio_renders_clean_and_leaves_no_trace(shape: str, capfd: pytest.CaptureFixture[str]) -> None:
    material = diffuse_material((0.8, 0.5, 0.3))
    before, current = datablocks(), bpy.context.scene
    scene = studio.build_studio(material, resolution=(48, 40), samples=32, shape=shape)
    shares: list[float] = []
    linear = studio.render_linear(scene, progress=shares.append)
    assert bpy.context.scene == current
    studio.remove_studio(scene)
    assert datablocks() == before
    assert linear.shape == (40, 48, 3) and linear.dtype == np.float32
    assert np.isfinite(linear).all() and linear.min() > 0
    # A firefly would stand far above the brightest lit white; matte surfaces in this light stay below 3.
    assert 0.05 < linear.mean() < 1 and linear.max() < 3
    # The warm material covers a good part of the picture, neither all nor nothing.
    warm = linear[..., 0] > 1.5 * linear[..., 2]
    assert 0.15 < warm.mean() < 0.7
    assert shares and shares == sorted(shares) and shares[-1] == 1
    assert capfd.readouterr() == ("", "")


def test_settings_do_not_bias_a_stochastic_mirror() -> None:
    scene = studio.build_studio(diffuse_material(), samples=7, seed=3)
    cycles = scene.cycles
    try:
        assert (cycles.samples, cycles.seed) == (7, 3)
        assert cycles.blur_glossy == cycles.sample_clamp_indirect == cycles.sample_clamp_direct == 0
        assert cycles.caustics_reflective and min(cycles.glossy_bounces, cycles.max_bounces) >= 8
        assert not (cycles.use_denoising or cycles.use_adaptive_sampling or cycles.use_guiding)
        lamps = [obj.data for obj in scene.collection.all_objects if obj.type == "LIGHT"]
        assert lamps and all(lamp.cycles.use_multiple_importance_sampling and lamp.size > 0 for lamp in lamps)
        assert all(obj.visible_glossy for obj in scene.collection.all_objects)
    finally:
        studio.remove_studio(scene)


@pytest.mark.parametrize("shape", ["ball", "sphere"])
def test_nothing_that_is_shown_is_cut(shape: str) -> None:
    material = diffuse_material()
    scene = studio.build_studio(material, resolution=(300, 300), shape=shape)
    try:
        scene.view_layers[0].update()
        shown = [obj for obj in scene.objects if obj.type == "MESH" and obj.active_material == material]
        corners = [obj.matrix_world @ vertex.co for obj in shown for vertex in obj.data.vertices]
        places = np.array([world_to_camera_view(scene, scene.camera, corner)[:2] for corner in corners])
        assert places.min() > 0.03 and places.max() < 0.97
    finally:
        studio.remove_studio(scene)


def test_seed_decides_the_noise() -> None:
    with lit_sphere(diffuse_material(), resolution=16) as test:
        first, again, other = test.render(samples=2, seeds=[5, 5, 6])
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_environment_lights_the_studio(tmp_path: Path) -> None:
    sky = np.zeros((8, 16, 3), np.uint8)
    sky[:4] = (0, 0, 255)
    write_png(tmp_path / "sky.png", sky)
    before = datablocks()
    scene = studio.build_studio(
        principled_material(Base_Color=1.0), resolution=(24, 24), samples=4, environment=tmp_path / "sky.png"
    )
    linear = studio.render_linear(scene)
    studio.remove_studio(scene)
    assert linear[..., 2].mean() > 0.05 and linear[..., :2].max() == 0
    after = datablocks()
    after["materials"] -= {"principled", *(name for name in after["materials"] if name.startswith("principled."))}
    before["materials"] -= {name for name in before["materials"] if name.startswith("principled")}
    assert after == before


@pytest.mark.parametrize("content", [None, b"this is no picture"])
def test_bad_environment_is_one_clear_line(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "sky.hdr"
    if content is not None:
        file.write_bytes(content)
    material, before = diffuse_material(), datablocks()
    before = datablocks()
    with pytest.raises(BakeError, match=r"sky\.hdr: cannot be read"):
        studio.build_studio(material, environment=file)
    assert datablocks() == before


def test_render_png_shows_the_linear_picture(tmp_path: Path) -> None:
    with lit_sphere(diffuse_material(), resolution=16) as test:
        test.scene.cycles.samples = 1
        linear = studio.render_png(test.scene, tmp_path / "a" / "ball.png")
        studio.render_linear(test.scene, tmp_path / "ball.exr")
    assert np.array_equal(np.rint(255 * image_pixels(tmp_path / "a" / "ball.png")), to_display(linear))
    assert np.array_equal(image_pixels(tmp_path / "ball.exr").astype(np.float32), linear)
    (tmp_path / "file").write_text("")
    with pytest.raises(BakeError, match="cannot be written"):
        write_png(tmp_path / "file" / "ball.png", to_display(linear))


def test_pictures_stand_upright_and_diffuse_reflects_its_albedo() -> None:
    with furnace(diffuse_material((0.6, 0.4, 0.2)), radiance=2.0, resolution=32) as test:
        pictures, mask = test.render(samples=64, seeds=4), test.mask()
    # 0.2 % is five standard errors of 4 x 64 samples in some 400 pixels (measured: 0.03 %).
    assert pictures[:, mask].mean(axis=(0, 1)) == pytest.approx([1.2, 0.8, 0.4], rel=0.002)
    assert pictures[:, 0] == pytest.approx(2.0, rel=1e-6)
    with lit_sphere(diffuse_material(), resolution=32) as test:
        picture, lit_mask = test.render(samples=8, seeds=1)[0], test.mask()
    assert np.array_equal(lit_mask, mask)
    # Lamp and sky are above, to the right.
    assert picture[:16][mask[:16]].mean() > 1.3 * picture[16:][mask[16:]].mean()
    assert picture[:, 16:][mask[:, 16:]].mean() > 1.1 * picture[:, :16][mask[:, :16]].mean()


def test_renders_of_one_material_agree_and_a_darker_one_does_not() -> None:
    with lit_sphere(diffuse_material(0.5), resolution=32) as test:
        mask = test.mask()
        first, second = test.render(16, range(6)), test.render(16, range(6, 12))
        test.show(diffuse_material(0.49))
        darker = test.render(16, range(12, 18))
    monte_carlo.assert_agree(monte_carlo.compare(first, second, mask), finds=0.02)
    assert not monte_carlo.compare(first, darker, mask).passed


@pytest.mark.parametrize(
    "mesh",
    [studio_meshes.sphere_mesh, studio_meshes.ring_mesh, lambda: studio_meshes.sphere_mesh(grooved=True)],
)
def test_shapes_are_closed_and_face_outwards(mesh) -> None:
    made = mesh()
    vertices = np.array([vertex.co for vertex in made.vertices])
    made.calc_loop_triangles()
    a, b, c = (vertices[[t.vertices[k] for t in made.loop_triangles]] for k in range(3))
    # Positive volume of the signed tetrahedra: normals point out of the body.
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    used = np.zeros(len(made.edges), int)
    np.add.at(used, [loop.edge_index for loop in made.loops], 1)
    assert (used == 2).all()
    assert not made.validate()
    bpy.data.meshes.remove(made)


def test_tone_curve_keeps_colours_and_orders_highlights() -> None:
    ramp = np.linspace(0, 1, 256)
    grey = to_display(np.repeat(((ramp + 0.055) / 1.055)[:, None] ** 2.4, 3, axis=1))[12:200]
    assert np.array_equal(grey[:, 0], np.arange(12, 200))  # sRGB above its linear foot, below the shoulder
    bright = to_display(np.array([[0.8, 0.2, 0.1], [2, 0.5, 0.25], [50, 12.5, 6]])).astype(int)
    assert (np.diff(bright[:, 0]) > 0).all() and bright.max() <= 255
    assert (bright[:, 0] > bright[:, 1]).all()
    assert to_display(np.array([-1.0, 0, 0])).tolist() == [0, 0, 0]
    assert to_display(np.array([np.nan, 0, np.inf])).tolist() == [255, 0, 255]


def test_sheet_holds_every_cell_with_or_without_lettering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    colours = [(200, 30, 30), (30, 200, 30), (30, 30, 200)]
    cells = [Cell(np.full((40, 60, 3), c, np.uint8), f"cell {k}", "a note") for k, c in enumerate(colours)]
    write_sheet(tmp_path / "lettered.png", cells, 2, "Title")
    assert not (tmp_path / "lettered.txt").exists()
    monkeypatch.setitem(__import__("sys").modules, "PIL", None)
    write_sheet(tmp_path / "plain.png", cells, 2, "Title")
    lettered, plain = (np.rint(255 * image_pixels(tmp_path / f"{n}.png")) for n in ("lettered", "plain"))
    for colour in colours:
        assert ((lettered == colour).all(axis=-1)).sum() == ((plain == colour).all(axis=-1)).sum() == 40 * 60
    assert (lettered != plain).any()
    assert "row 2, column 1: cell 2 (a note)" in (tmp_path / "plain.txt").read_text()
    with pytest.raises(ValueError, match="one cell"):
        write_sheet(tmp_path / "none.png", [], 2)

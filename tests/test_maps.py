"""Maps of photographs lit from all sides: against surfaces of known normals, and as the programs read them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.maps.bake import MapSettings, bake_maps, maps_of
from measured_materials.bake.maps.gloss import Gloss, fit_gloss, ggx_lobe
from measured_materials.bake.maps.height import height_of, unfollowed
from measured_materials.bake.maps.normals import Surface, check_directions, photometric_stereo
from measured_materials.bake.maps.surface import surface_of
from measured_materials.bake.maps.write import Maps, write_maps
from measured_materials.bake.photographs import PhotoStack, StackSettings, read_stack
from measured_materials.bake.photographs.photograph import read_photograph
from measured_materials.bake.source import luminance
from measured_materials.bake.sources import analytic
from PIL import Image
from support.known_maps import N, degrees, lights, photographs, relief, write_photographs


def pixels(file: Path) -> np.ndarray:
    """Of a PNG, in [0, 1], as the reader of photographs has them."""
    found = read_photograph(file).pixels
    return found / np.iinfo(found.dtype).max


def test_a_matte_surface_is_found_whatever_lies_in_shadow() -> None:
    """A tenth of all values are shadow; plain least squares, Woodham's, is the baseline."""
    directions, (_, normals, albedo) = lights(16), relief()
    images = photographs(directions, shadows=0.1)
    surface = photometric_stereo(images, directions)
    plain = photometric_stereo(images, directions, robust=False)
    # The fit leans towards the camera by 1e-4 of its weight, and a texel of many shadows by more.
    assert degrees(surface.normals, normals).mean() < 0.1 < 3 < degrees(plain.normals, normals).mean()
    np.testing.assert_allclose(np.median(np.abs(surface.albedo - albedo) / albedo), 0, atol=1e-3)


def test_gloss_is_told_from_slope() -> None:
    """By turns: half of the error that the robust fit leaves, which leaves a third of the plain one's."""
    directions, (_, normals, albedo) = lights(16), relief()
    images = photographs(directions, gloss=0.05)
    surface, gloss = surface_of(images, directions)
    robust = degrees(photometric_stereo(images, directions).normals, normals).mean()
    plain = degrees(photometric_stereo(images, directions, robust=False).normals, normals).mean()
    assert degrees(surface.normals, normals).mean() < 0.5 * robust < 0.5 * 0.3 * plain
    assert np.abs(surface.albedo - albedo).mean() < 0.02 * albedo.mean()
    assert gloss.told.mean() > 0.7
    assert np.median(gloss.roughness) == pytest.approx(0.43, abs=0.01)
    assert np.median(gloss.strength) == pytest.approx(0.05, rel=0.03)
    # What the lobe adds is what was added.
    added = images - photographs(directions)
    assert np.abs(gloss.shown(directions, surface.normals) - added[..., 0]).mean() < 0.1 * added.mean()


def test_a_turn_serves_every_texel_or_is_not_taken() -> None:
    """Under few lights and much gloss many a turn would explain the photographs worse."""
    directions = lights(6)
    images = photographs(directions, gloss=0.3, roughness=0.5, shadows=0.1)

    def left(surface: Surface, gloss: Gloss) -> np.ndarray:
        lit = np.maximum(np.einsum("ni,hwi->nhw", directions, surface.normals), 0)
        seen = lit * luminance(surface.albedo) / np.pi + gloss.shown(directions, surface.normals)
        return np.abs(luminance(images) - seen).mean(0)

    first = photometric_stereo(images, directions)
    before, after = left(first, fit_gloss(images, directions, first)), left(*surface_of(images, directions))
    assert (after <= before * 1.001).all() and (after < 0.9 * before).mean() > 0.2


def test_the_lobe_is_that_of_the_formula() -> None:
    """GGX with a reflectance of 1 at every angle, as sources have it."""
    rng = np.random.default_rng(2)
    wi, wo = (spherical(np.arccos(rng.uniform(0.02, 1, 400)), rng.uniform(-np.pi, np.pi, 400)) for _ in range(2))
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
    for roughness in (0.3, 0.6, 0.9):
        f = analytic.Ggx(alpha=roughness**2, f0=(1.0, 1.0, 1.0)).evaluate(wi, wo)
        lobe = ggx_lobe(roughness**2, wi[:, 2], half[:, 2], wo[:, 2])
        np.testing.assert_allclose(lobe, f[:, 0] * wi[:, 2], rtol=1e-6)


def test_matte_surfaces_have_no_gloss() -> None:
    directions = lights(8)
    images = photographs(directions)
    gloss = fit_gloss(images, directions, photometric_stereo(images, directions))
    assert gloss.told.mean() < 0.05 and not gloss.strength.any()


@pytest.mark.parametrize("repeats", [True, False])
def test_height_has_these_slopes(repeats: bool) -> None:
    """The relief itself where it repeats, and a slope that does not but at its edges, where it is held."""
    height, normals, _ = relief()
    found = height_of(normals, repeats=repeats)
    # Central differences flatten the shortest wave by 1 - sinc(2 pi 5 / 48).
    assert np.corrcoef(found.ravel(), height.ravel())[0, 1] > 0.998
    assert abs(np.polyfit(height.ravel(), found.ravel(), 1)[0] - 1) < 0.03
    assert unfollowed(normals, found) < 0.08
    ramp = np.broadcast_to(np.array([-0.6, 0.0, 0.8]), (N, N, 3))
    rise = height_of(ramp)
    middle = rise[N // 2, N // 4 : 3 * N // 4]
    # Its mirror image turns back at the edges, and a transform rings there: 1.8 % are seen.
    np.testing.assert_allclose(np.diff(middle), 0.75, rtol=0.04)
    # y is up, and rows run down.
    downwards = height_of(np.broadcast_to(np.array([0.0, -0.6, 0.8]), (N, N, 3)))
    assert downwards[N // 4, 0] > downwards[3 * N // 4, 0]


@pytest.mark.parametrize(
    ("directions", "cause"),
    [
        (None, "no known directions"),
        (lights(16)[:3], "are 3 only"),
        (np.array([[np.cos(a), 0, np.sin(a)] for a in np.radians([20, 40, 60, 80, 120])]), "lie in one plane"),
    ],
)
def test_lights_that_tell_no_normal_are_refused(directions: np.ndarray | None, cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        check_directions(directions)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of the relief, a little gloss on it, as a person has them."""
    directions = lights(8)
    folder = tmp_path_factory.mktemp("stacks") / "relief"
    return write_photographs(folder, photographs(directions, gloss=0.04), directions)


def test_maps_as_programs_read_them(folder: Path, tmp_path: Path) -> None:
    """Blender's and glTF's green is up, DirectX' down; EXR holds what PNG encodes."""
    stack = StackSettings(albedo=0.29)
    made = bake_maps(folder, tmp_path / "png", MapSettings(stack=stack, level=False, repeats=True))
    assert {p.name for p in made.path.iterdir()} == {
        *(f"{name}.png" for name in ("normal", "albedo", "height", "roughness", "specular")),
        "maps.json",
        "maps.mtlx",
    }
    facts = json.loads((made.path / "maps.json").read_text())
    assert facts == json.loads(json.dumps(made.facts)) and facts["calibrated"]
    exact = bake_maps(folder, tmp_path / "exr", MapSettings("directx", "exr", level=False, repeats=True, stack=stack))
    _, normals, _ = relief()
    png = pixels(made.path / "normal.png")
    read = 2 * png - 1
    assert degrees(read / np.linalg.norm(read, axis=-1, keepdims=True), normals).mean() < 1.0
    down = 2 * read_image(exact.path / "normal.exr") - 1
    np.testing.assert_allclose(down * [1, -1, 1], read, atol=2 / 65535 + 1e-6)
    with Image.open(made.path / "height.png") as opened:
        assert opened.mode == "I;16"
        height = np.array(opened) / 65535 * facts["maps"]["height"]["scale"] + facts["maps"]["height"]["lowest"]
    np.testing.assert_allclose(height, read_image(exact.path / "height.exr")[..., 0], atol=1e-4)
    # Blender's Displacement takes Midlevel off, and multiplies by Scale: the mean height stays where it is.
    about = facts["maps"]["height"]
    np.testing.assert_allclose(((height - about["lowest"]) / about["scale"] - about["midlevel"]).mean(), 0, atol=1e-3)
    # In widths of the picture, of 48 texels.
    assert np.ptp(height) * N == pytest.approx(np.ptp(relief()[0]), rel=0.1)
    albedo = read_image(exact.path / "albedo.exr")
    assert albedo.mean() == pytest.approx(0.29, rel=0.05)
    with Image.open(made.path / "albedo.png") as opened:
        assert opened.mode == "RGB"
    specular, f0 = read_image(made.path / "specular.png")[..., 0], read_image(exact.path / "specular.exr")[..., 0]
    np.testing.assert_allclose(specular, np.clip(f0 / 0.08, 0, 1), atol=0.003)
    assert np.median(f0) == pytest.approx(0.04, rel=0.15)


def test_sixteen_bits_are_whole(tmp_path: Path) -> None:
    """Of every channel, as another library reads them."""
    ramp = np.linspace(0, 1, 4096, dtype=np.float32).reshape(64, 64)
    flat = np.zeros((64, 64, 3), np.float32)
    flat[..., 2] = 1
    write_maps(tmp_path, Maps(flat, flat, ramp, ramp, ramp), "opengl", "png16")
    with Image.open(tmp_path / "height.png") as opened:
        assert np.abs(np.array(opened).ravel() - np.linspace(0, 65535, 4096)).max() <= 0.51
    np.testing.assert_allclose(pixels(tmp_path / "normal.png")[0, 0], [0.5, 0.5, 1.0], atol=1e-4)


def test_a_near_lamp_makes_no_bowl(folder: Path) -> None:
    """Slopes that grow evenly across the frame are left out where the swatch is flat; the relief stays."""
    settings = MapSettings(repeats=True)
    stack = read_stack(folder, settings.stack.all_around())
    assert stack.directions is not None
    _, normals, _ = relief()
    plain, _, _ = maps_of(stack, MapSettings(level=False, repeats=True), "relief")
    place = (np.arange(N) / N - 0.5) * 0.4
    bent = normals + np.dstack([*np.meshgrid(-place, place), np.zeros((N, N))])
    bent /= np.linalg.norm(bent, axis=-1, keepdims=True)
    lit = np.maximum(np.einsum("ni,hwi->nhw", stack.directions, bent), 0)
    images = (lit[..., None] * relief()[2] / np.pi).astype(np.float32)
    bowl = PhotoStack(images, stack.names, stack.directions, True, ())
    levelled, facts, _ = maps_of(bowl, settings, "bowl")
    assert facts["levelled_deg"] > 5
    assert (
        degrees(levelled.normal, normals).mean()
        < 2
        < degrees(maps_of(bowl, MapSettings(level=False), "bowl")[0].normal, normals).mean()
    )
    assert degrees(plain.normal, normals).mean() < 1


def test_a_folder_of_other_things_is_left_alone(folder: Path, tmp_path: Path) -> None:
    """And maps of before are replaced."""
    target = tmp_path / "relief"
    target.mkdir()
    (target / "notes.txt").write_text("mine")
    with pytest.raises(BakeError, match="holds other files"):
        bake_maps(folder, target)
    assert [p.name for p in tmp_path.iterdir()] == ["relief"] and (target / "notes.txt").read_text() == "mine"
    (target / "notes.txt").unlink()
    bake_maps(folder, target)
    bake_maps(folder, target, MapSettings(files="png8"))
    (target / "notes.txt").write_text("mine")
    with pytest.raises(BakeError, match=r"other files \(notes.txt\)"):
        bake_maps(folder, target)


def test_maps_of_other_photographs_are_not_replaced(folder: Path, tmp_path: Path) -> None:
    """Unless that is asked for."""
    other = tmp_path / "other" / "relief"
    shutil.copytree(folder, other)
    write_image(other / "p00.exr", 0.5 * read_image(other / "p00.exr"), Storage.HALF)
    target = tmp_path / "relief_maps"
    bake_maps(folder, target)
    before = (target / "maps.json").read_bytes()
    with pytest.raises(BakeError, match="holds maps of other photographs"):
        bake_maps(other, target)
    assert (target / "maps.json").read_bytes() == before
    bake_maps(other, target, replace=True)
    assert (target / "maps.json").read_bytes() != before


def test_gloss_beyond_what_png_holds_is_told(tmp_path: Path) -> None:
    directions = lights(8)
    stack = PhotoStack(photographs(directions, gloss=0.3), tuple("abcdefghijklmnopqrst"), directions, True, ())
    assert any("--files exr" in warning for warning in maps_of(stack, MapSettings(), "chrome")[2])
    assert not any("--files exr" in warning for warning in maps_of(stack, MapSettings(files="exr"), "chrome")[2])


def test_the_command_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One bad folder stops no other, and two of one name are refused before anything is read."""
    empty = tmp_path / "empty"
    empty.mkdir()
    assert main(["bake", "maps", str(empty), str(folder), "--out", str(tmp_path / "out"), "--json"]) == 1
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert [Path(made["path"]).name for made in told["maps"]] == ["relief_maps"] and len(told["errors"]) == 1
    assert "not calibrated" in told["maps"][0]["warnings"][0]
    assert not (tmp_path / "out" / "empty_maps").exists()
    twin = tmp_path / "other" / "Relief"
    twin.mkdir(parents=True)
    assert main(["bake", "maps", str(folder), str(twin), "--out", str(tmp_path / "two")]) == 2
    assert "two folders would become" in capsys.readouterr().err and not (tmp_path / "two").exists()


@pytest.mark.parametrize("plate", ["single1", pytest.param("single3", marks=pytest.mark.slow), "single5"])
def test_rendered_plates_have_their_true_normals(shared_data: Path, plate: str) -> None:
    """Renders of another program with its normals, matte to glossy: at most 5 degrees, and half of the baseline."""
    dome = shared_data / "stacks" / "rendered_plate" / plate / "Dome"
    lit = StackSettings(lights=dome / "dirs.lp", align="off", size=96)
    stack = read_stack(sorted(dome.glob("image*.jpg")), lit.all_around())
    assert stack.directions is not None
    with Image.open(dome / "normals.png") as opened:
        truth = np.array(opened.resize((96, 96), Image.Resampling.BOX), float) / 127.5 - 1
    truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
    plain = degrees(photometric_stereo(stack.images, stack.directions, robust=False).normals, truth).mean()
    maps, _, _ = maps_of(stack, MapSettings(level=False), plate)
    ours = degrees(maps.normal, truth).mean()
    assert ours < (0.8 * plain if plate == "single1" else 0.55 * plain) and ours < 5

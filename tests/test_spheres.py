"""Directions of lights by mirror spheres in the picture: against lights that are known, and where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import StackSettings, read_stack
from measured_materials.bake.photographs.light_files.spheres import light_on_sphere, lights_on_spheres
from measured_materials.bake.photographs.photograph import PhotoInfo, read_info
from measured_materials.bake.photographs.stack import lights_by_spheres
from PIL import Image

SIZE = 240
SPHERES = ((62.3, 60.7, 55.0), (180.0, 183.5, 48.0))
# Every elevation and azimuth.
LIGHTS = [(e, a) for e in (8, 25, 45, 65, 85) for a in (0, 50, 140, 200, 310)]


def direction(elevation: float, azimuth: float) -> np.ndarray:
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def picture(wi: np.ndarray, spheres: tuple = SPHERES, lamp: float = 3.0, dim: float = 0.05) -> np.ndarray:
    """(SIZE, SIZE, 3): spheres of a mirror on a matte table under a lamp of this radius in degrees, traced by
    reflection, four by four rays a pixel; the table is what a mirror shows outside."""
    offsets = (np.arange(4 * SIZE) + 0.5) / 4
    x, y = np.meshgrid(offsets, offsets)
    image = np.full(x.shape, 0.2 * wi[2])
    for sx, sy, r in spheres:
        nx, ny = (x - sx) / r, (sy - y) / r
        inside = nx**2 + ny**2 < 1
        nz = np.sqrt(np.maximum(1 - nx**2 - ny**2, 0))
        mirrored = np.stack([2 * nz * nx, 2 * nz * ny, 2 * nz**2 - 1], -1)
        shown = np.where(mirrored[..., 2] > 0, dim, 0.2)
        shown = np.where(mirrored @ wi > np.cos(np.radians(lamp)), 40.0, shown)
        image = np.where(inside, shown, image)
    image = image.reshape(SIZE, 4, SIZE, 4).mean((1, 3))
    return np.repeat(np.clip(image, 0, 1)[..., None], 3, -1)


def off(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_lights_are_found_to_half_a_degree() -> None:
    """Overexposed highlights of a few pixels, anywhere above the table."""
    errors = []
    for light in LIGHTS:
        wi = direction(*light)
        found, spread = lights_on_spheres(Path("p.png"), picture(wi), SPHERES)
        errors.append(off(found, wi))
        assert spread < 2
    assert max(errors) < 1 and np.mean(errors) < 0.4, (max(errors), np.mean(errors))


def test_a_large_lamp_is_found_by_its_middle() -> None:
    """A softbox of 30 degrees: the mean of directions, not of places in the picture."""
    wi = direction(50, 30)
    assert off(light_on_sphere(Path("p.png"), picture(wi, lamp=15.0), SPHERES[0]), wi) < 0.6


@pytest.mark.parametrize(
    ("sphere", "cause"),
    [
        ((170.0, 60.0, 40.0), "shows no highlight on the sphere 170,60,40"),
        ((20.0, 60.0, 30.0), "240 x 240, and the sphere 20,60,30 reaches outside"),
    ],
)
def test_no_sphere_is_an_error_of_its_own(sphere: tuple[float, float, float], cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        light_on_sphere(Path("p.png"), picture(direction(40, 20)), sphere)
    with pytest.raises(BakeError, match="no highlight"):  # evenly bright
        light_on_sphere(Path("p.png"), np.ones((80, 80, 3)), (40, 40, 30))
    thread = np.full((80, 80, 3), 0.2)
    thread[38:42, 30:36] = 0.4
    with pytest.raises(BakeError, match="no highlight"):
        light_on_sphere(Path("p.png"), thread, (40, 40, 30))


def test_noise_and_defects_of_the_sensor_are_no_highlights() -> None:
    """In a dark room, where the lamp was off or the circle lies beside its sphere; and beside a highlight."""
    x, y, _ = SPHERES[0]
    for value in (1, 4, 255):
        black = np.zeros((SIZE, SIZE, 3), np.uint8)
        black[int(y) + 9, int(x) - 12] = value
        with pytest.raises(BakeError, match="no highlight"):
            light_on_sphere(Path("p.png"), black, SPHERES[0])
    with pytest.raises(BakeError, match="no highlight"):
        light_on_sphere(Path("p.png"), noise(), SPHERES[0])
    wi = direction(50, 30)
    lit = 0.3 * picture(wi)  # a highlight that does not saturate
    lit[int(y) + 9, int(x) - 12] = 1.0
    assert off(light_on_sphere(Path("p.png"), lit, SPHERES[0]), wi) < 1


def test_of_a_bracket_the_shortest_that_shows_a_highlight_tells_the_light(tmp_path: Path) -> None:
    """A frame that is black but for noise tells none, and what a blown-out one tells is not warned of."""
    folder = tmp_path / "brackets"
    folder.mkdir()
    ways = [direction(*light) for light in LIGHTS[5:20:2]]
    for k, wi in enumerate(ways):
        usual = 200 * picture(wi)
        blown = np.clip(6 * usual, 0, 255)
        blown[int(SPHERES[0][1]) - 30 :, int(SPHERES[0][0]) :][:25, :25] = 255  # flare on one of both spheres
        for mark, codes in (("-4", noise()), ("0", usual), ("+2", blown)):
            Image.fromarray(np.rint(codes).astype(np.uint8)).save(folder / f"p{k}_ev{mark}.png")
    settings = StackSettings(spheres=SPHERES, crop=(130, 20, 90, 90), align="off", spread=90.0, sides="both")
    lights = lights_by_spheres(*found_in(folder), settings)
    assert lights.directions is not None
    for found, wi in zip(lights.directions[::3], ways, strict=True):
        assert off(found, wi) < 1
    assert not lights.warnings


def noise() -> np.ndarray:
    """Of a black frame: a fifth of its pixels are 1 to 3 of 255."""
    rng = np.random.default_rng(0)
    lit = rng.random((SIZE, SIZE, 1)) < 0.2
    return np.where(lit, rng.integers(1, 4, (SIZE, SIZE, 3)), 0).astype(np.uint8)


def found_in(folder: Path) -> tuple[list[Path], list[PhotoInfo]]:
    paths = sorted(folder.iterdir())
    return paths, [read_info(path) for path in paths]


def test_spheres_that_are_none_are_refused_in_a_line() -> None:
    for wrong in (5, None, "1,2,30", (62.3, 60.7, 55.0)):
        with pytest.raises(BakeError, match=r"photograph settings: (a sphere|spheres) is"):
            StackSettings(spheres=wrong)  # type: ignore[arg-type]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Photographs of a table with two spheres."""
    folder = tmp_path / "table"
    folder.mkdir()
    for k, light in enumerate(LIGHTS[5:20:2]):
        Image.fromarray(np.rint(255 * picture(direction(*light))).astype(np.uint8)).save(folder / f"p{k}.png")
    return folder


def test_stacks_have_their_lights(folder: Path) -> None:
    settings = StackSettings(spheres=SPHERES, crop=(130, 20, 90, 90), align="off", spread=90.0, sides="both")
    stack = read_stack(folder, settings)
    assert stack.directions is not None and stack.facts["lights"]["source"] == "spheres"
    for found, light in zip(stack.directions, LIGHTS[5:20:2], strict=True):
        assert off(found, direction(*light)) < 1
    assert not any("sphere" in warning for warning in stack.warnings)
    whole = read_stack(folder, StackSettings(spheres=SPHERES, align="off", spread=90.0, sides="both"))
    assert any("crop to the swatch" in warning for warning in whole.warnings)


def test_a_circle_beside_its_sphere_is_told(folder: Path) -> None:
    x, y, radius = SPHERES[1]
    wrong = (SPHERES[0], (x + 5, y, radius))
    settings = StackSettings(spheres=wrong, crop=(130, 20, 90, 90), align="off", spread=90.0, sides="both")
    assert any("degrees off their mean" in warning for warning in read_stack(folder, settings).warnings)


def test_the_command_line_takes_them(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = [part for sphere in SPHERES for part in ("--sphere", ",".join(f"{x:g}" for x in sphere))]
    common = ["--crop", "130,20,90,90", "--size", "30", "--align", "off", "--out", str(tmp_path / "out")]
    assert main(["bake", "maps", str(folder), *given, *common]) == 0
    assert main(["bake", "photographs", str(folder), *given, *common]) == 0
    (folder / "lights.csv").write_text("file,elevation\np0.png,20\n")
    capsys.readouterr()
    assert main(["bake", "maps", str(folder), *given, "--lights", str(folder / "lights.csv"), *common]) == 2
    assert "both a lights file and spheres" in capsys.readouterr().err
    assert main(["bake", "maps", str(folder), "--sphere", "170,60,40", *common]) == 1
    assert "p0.png: shows no highlight on the sphere 170,60,40" in capsys.readouterr().err


def test_lists_of_any_name_are_read(folder: Path) -> None:
    """Where one lists all photographs: "name x y z" with any suffix of text, in the folder or above it."""
    ways = [direction(*light) for light in LIGHTS[5:20:2]]
    lines = [f"p{k}.png {x:.6f} {y:.6f} {z:.6f}" for k, (x, y, z) in enumerate(ways)]
    settings = StackSettings(align="off", spread=90.0, sides="both")
    for place in (folder / "dome.dat", folder / "positions.txt", folder.parent / "dome.lp", folder.parent / "all.tsv"):
        place.write_text("\n".join(lines) if place.suffix != ".lp" else "\n".join([str(len(lines)), *lines]))
        stack = read_stack(folder, settings)
        assert stack.directions is not None
        np.testing.assert_allclose(stack.directions, ways, atol=1e-5)
        assert stack.facts["lights"]["source"] == place.name
        place.unlink()
    # One line less, or two such files: neither is taken, and nothing is guessed.
    (folder / "some.txt").write_text("\n".join(lines[1:]))
    assert read_stack(folder, settings).directions is None
    for name in ("one.txt", "two.txt"):
        (folder / name).write_text("\n".join(lines))
    assert read_stack(folder, settings).directions is None

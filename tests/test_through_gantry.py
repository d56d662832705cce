"""The virtual gantry with its lamp behind the swatch, and a bake of what it photographs, against the geometry."""

from __future__ import annotations

import csv
import json
import math
import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.gantry.photograph_arc import photograph_arc, photograph_view
from measured_materials.addon.gantry.swatches.voile import voile
from measured_materials.addon.gantry.techniques import Light, mapped_swatch, shade
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.stack import read_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes import compat
from support.clean_blend import clean_blend  # noqa: F401

SIZE = 48
ELEVATIONS = [12.0, 25.0, 40.0, 60.0, 88.0]


def pane() -> bpy.types.Material:
    """Lets 0.3 of the light through, scattered evenly, and reflects 0.2."""
    material = compat.new_material("pane")
    tree = material.node_tree
    both, output = tree.nodes.new("ShaderNodeAddShader"), tree.nodes.new("ShaderNodeOutputMaterial")
    for k, (kind, share) in enumerate((("Diffuse", 0.2), ("Translucent", 0.3))):
        closure = tree.nodes.new(f"ShaderNodeBsdf{kind}")
        closure.inputs["Color"].default_value = (share, share, share, 1)
        tree.links.new(closure.outputs[0], both.inputs[k])
    tree.links.new(both.outputs[0], output.inputs["Surface"])
    return material


def test_a_pane_against_the_light_is_f_cos(tmp_path: Path) -> None:
    folder = tmp_path / "arc"
    files = photograph_arc(pane(), folder, elevations=[30.0, 75.0], azimuth=20.0, size=8, samples=16, behind=True)
    for file, elevation in zip(files, (30.0, 75.0), strict=True):
        expected = 0.3 / math.pi * math.sin(math.radians(elevation))
        frame = read_image(file)[..., :3]
        # Along the diagonal a ray to the lamp may hit the other triangle, at no distance at all.
        assert np.median(frame) == pytest.approx(expected, rel=1e-3) and frame.mean() == pytest.approx(
            expected, rel=0.02
        )
    with open(folder / "lights.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["elevation"], row["azimuth"]) for row in rows] == [("-30", "20"), ("-75", "20")]


@pytest.fixture(scope="module")
def stacks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Voile from the front and against the light."""
    folder = tmp_path_factory.mktemp("voile")
    swatch = voile()
    for name, behind in (("front", False), ("behind", True)):
        photograph_arc(swatch, folder / name, elevations=ELEVATIONS, size=SIZE, samples=64, azimuth=30.0, behind=behind)
    return folder / "front", folder / "behind"


def bake(stacks: tuple[Path, Path], out: Path, *options: str) -> tuple[int, ShadingMapRecord | None]:
    arguments = ["bake", "photographs", str(stacks[0]), "--through", str(stacks[1]), "--size", "0", "--out", str(out)]
    code = main([*arguments, "--align", "off", *options])
    bundle = out / "front.mmat"
    return code, ShadingMapRecord.read(read_bundle(bundle)) if bundle.is_dir() else None


def rms(found: Any, truth: Any) -> float:
    return float(np.sqrt(((found - truth) ** 2).mean() / (truth**2).mean()))


def test_voile_between_its_photographs(stacks: tuple[Path, Path], tmp_path: Path) -> None:
    """Light from behind at an elevation that was not photographed: closer than a lit texture is."""
    transmittance = float(np.mean([read_image(f).mean() for f in sorted(stacks[1].glob("el088*"))]) * math.pi)
    code, record = bake(stacks, tmp_path, "--albedo", "0.3", "--transmittance", f"{transmittance:.4f}")
    assert code == 0 and record is not None
    behind = record.transmitted()
    assert behind is not None and behind.map.a_max is not None and record.map.a_max is not None
    theta, phi = math.radians(90 - 32), math.radians(30)
    truth = photograph_view(voile(), light=(theta, phi), behind=True, size=SIZE, samples=256)
    uv = (np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)[::-1]), -1) + 0.5) / SIZE
    swatch = mapped_swatch(read_bundle(tmp_path / "front.mmat"), through=True)
    light = Light((math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)))
    found = {name: shade(name, swatch, [light], (0, 0, 1), uv) for name in ("lookup", "lit_texture")}
    # Up to the brightness, which follows f_t.
    errors = {name: rms(value * truth.mean() / value.mean(), truth) for name, value in found.items()}
    print(errors, transmittance)
    assert errors["lookup"] < 0.12 and errors["lookup"] < 0.7 * errors["lit_texture"]
    assert found["lookup"].mean() == pytest.approx(truth.mean(), rel=0.25)


def test_what_is_told_of_a_bake(stacks: tuple[Path, Path], tmp_path: Path, capsys: Any) -> None:
    code, record = bake(stacks, tmp_path, "--albedo", "0.3", "--transmittance", "0.38", "--transmission", "phong")
    told = capsys.readouterr()
    assert code == 0 and record is not None and record.through is not None
    assert "transmittance" in told.out and not [line for line in told.err.splitlines() if "horizon" in line]
    assert record.render.transmission.name == "phong" and record.through.render.lobe == record.render.transmission
    document = json.loads((tmp_path / "front.mmat" / "material.json").read_text())
    assert document["schema"] == 5 and document["settings"]["through"]["source"] == "behind"
    assert str(tmp_path) not in json.dumps(document)
    assert record.through.photographs.calibrated_by == "transmittance"
    assert record.through.photographs.elevations_deg[-1] == pytest.approx(88)
    assert main(["inspect", str(tmp_path / "front.mmat")]) == 0
    words = capsys.readouterr().out
    assert "Through: transmittance 0°" in words and "Base transmission" not in words.split("Through: base")[0]
    assert (
        main(
            [
                "render",
                str(tmp_path / "front.mmat"),
                "--resolution",
                "16",
                "--samples",
                "4",
                "--out",
                str(tmp_path / "front.png"),
            ]
        )
        == 0
    )


def test_more_than_arrives_is_told(stacks: tuple[Path, Path], tmp_path: Path, capsys: Any) -> None:
    assert bake(stacks, tmp_path, "--albedo", "0.7", "--transmittance", "0.6")[0] == 0
    assert "reflected and let through: more light leaves than arrives" in capsys.readouterr().err
    assert main(["inspect", str(tmp_path / "front.mmat")]) == 0
    assert "R + T above one" in capsys.readouterr().out


def test_seams_are_common_to_both_maps(stacks: tuple[Path, Path], tmp_path: Path) -> None:
    """By one set of cuts: the last slices of both stay as alike as the photographs are."""
    _, plain = bake(stacks, tmp_path / "plain")
    _, tiled = bake(stacks, tmp_path / "tiled", "--tileable", "offset")
    alike = []
    for record in (plain, tiled):
        assert record is not None
        behind = record.transmitted()
        assert behind is not None
        both = [part.load_map().slices[-1].mean(-1) for part in (record, behind)]
        alike.append(np.corrcoef(*(image.ravel() for image in both))[0, 1])
    assert tiled is not None and tiled.tiling is not None
    assert alike[1] == pytest.approx(alike[0], abs=0.05) and alike[0] > 0.3


def test_a_diffuser_fixes_the_scale(stacks: tuple[Path, Path], tmp_path: Path) -> None:
    """Its f cos is known, and with it the swatch's, whatever the lamp was."""
    lit = tmp_path / "lit"
    lit.mkdir()
    for file in stacks[1].glob("*.exr"):
        frame = read_image(file)[..., :3]
        elevation = math.radians(float(file.stem[2:]))
        card = np.full((SIZE, 8, 3), 0.5 / math.pi * math.sin(elevation), np.float32)
        write_image(lit / file.name, np.concatenate([frame, card], 1) * 7.3, Storage.FLOAT32)
    shutil.copy(stacks[1] / "lights.csv", lit)
    front = tmp_path / "front"
    front.mkdir()
    for file in stacks[0].glob("*.exr"):
        frame = read_image(file)[..., :3]
        write_image(front / file.name, np.concatenate([frame, frame[:, :8]], 1), Storage.FLOAT32)
    shutil.copy(stacks[0] / "lights.csv", front)
    crop = f"0,0,{SIZE},{SIZE}"
    code, record = bake((front, lit), tmp_path / "out", "--crop", crop, "--diffuser", f"{SIZE + 1},4,6,{SIZE - 8}")
    assert code == 0 and record is not None and record.through is not None
    brightest = max(read_image(file)[..., :3].mean() for file in stacks[1].glob("*.exr"))
    assert record.through.map.a_max == pytest.approx(brightest, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--crop", "0,0,20,20", "--align", "off"], None),
        (["--transmittance", "1.5"], "transmittance"),
        (["--transmittance", "0.3", "--diffuser", "0,0,4,4"], "both a diffuser"),
        (["--transmission", "velvet"], "--transmission velvet"),
    ],
)
def test_settings_of_transmission(
    stacks: tuple[Path, Path], tmp_path: Path, options: list[str], says: str | None, capsys: Any
) -> None:
    code, _ = bake(stacks, tmp_path, *options)
    told = capsys.readouterr().err
    assert (code == 0) is (says is None) and (says or "") in told and "Traceback" not in told


def test_what_does_not_belong_together_is_refused(stacks: tuple[Path, Path], tmp_path: Path, capsys: Any) -> None:
    small = tmp_path / "small"
    small.mkdir()
    for file in stacks[1].glob("*.exr"):
        write_image(small / file.name, read_image(file)[:30, :, :3], Storage.FLOAT32)
    shutil.copy(stacks[1] / "lights.csv", small)
    assert bake((stacks[0], small), tmp_path / "out")[0] == 1
    assert "another frame than the others: 48 x 48 and 48 x 30" in capsys.readouterr().err
    mixed = tmp_path / "mixed"
    shutil.copytree(stacks[1], mixed)
    text = (mixed / "lights.csv").read_text().replace("-12", "12")
    (mixed / "lights.csv").write_text(text)
    assert bake((stacks[0], mixed), tmp_path / "out")[0] == 1
    assert "lights on both sides" in capsys.readouterr().err
    assert main(["bake", "photographs", str(stacks[0]), "--transmittance", "0.3", "--out", str(tmp_path)]) == 2
    assert "give --through FOLDER too" in capsys.readouterr().err
    with pytest.raises(BakeError, match="every light lies below the horizon"):
        read_stack(stacks[1])

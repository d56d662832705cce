"""Textures stay their material's own through Unpack Resources, Find Missing Files and bundles of older versions."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

# Run apart: opening a file would take the scene of every other test away.
MAKE = """
import json, shutil, sys
from pathlib import Path
import bpy
import numpy as np
import measured_materials
from measured_materials.addon.material.facts import is_measured, record_of
from measured_materials.addon.material import bake_material as measured_material, texture_repair
from measured_materials.addon.scene_check import check as scene_check
from measured_materials.addon.material.textures.kept import TEXTURE_KEY, textures_of
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.sources import analytic
from measured_materials.nodes.data_image import CONTENT_KEY, PART_KEY

folder = Path(sys.argv[1])
SETTINGS = BakeSettings(resolution=8, alpha=(0.5, 0.5), sampler=SamplerLayout(n_o=8, n_h=8, n_phi=8), envelope=False)
measured_materials.register()
bpy.ops.wm.read_homefile(use_empty=True)


def save(name="scene.blend"):
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / name))


def open_again(file=None):
    bpy.ops.wm.open_mainfile(filepath=str(file or folder / "scene.blend"))


def bake(older=False):
    results = []
    for name, alpha in (("canvas", 0.3), ("satin", 0.6)):
        source = analytic.Ggx(alpha=alpha)
        object.__setattr__(source, "name", name)
        result = bake_source(source, folder / f"{name}.mmat", SETTINGS)
        if older:
            as_schema_2(result.path)
        results.append(result)
    return results


def as_schema_2(path):
    document = json.loads((path / "material.json").read_text())
    document["schema"] = 2
    for part, entry in document["images"].items():
        file = path / entry["file"]
        entry["file"] = file.rename(path / (part + file.suffix)).name
    (path / "material.json").write_text(json.dumps(document))


def build(results, pack):
    for result in results:
        material = measured_material.material_from(result, pack=pack)
        mesh = bpy.data.meshes.new(material.name)
        mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
        mesh.materials.append(material)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(material.name, mesh))


def forget_names():
    "As a version with schema 2 left it: packed under the bundle's common names, no content noted."
    for image in bpy.data.images:
        part = image.get(PART_KEY)
        if part:
            path = str(Path(image.filepath).with_name(part + Path(image.filepath).suffix))
            for packed in image.packed_files:
                packed.filepath = path
            image.filepath_raw = path
            del image[PART_KEY], image[CONTENT_KEY]


def is_right(bundles=None):
    "Every texture of every material holds the pixels that its bundle was written with."
    found = {}
    for material in bpy.data.materials:
        bundle = read_bundle((bundles or folder) / f"{material.name}.mmat")
        for part, image in textures_of(material).items():
            wanted = read_image(bundle.image_path(part))
            values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
            same = values.size >= wanted.size
            if same:
                image.pixels.foreach_get(values)
                values = values.reshape(image.size[1], image.size[0], -1)[::-1, :, : wanted.shape[2]]
                same = values.shape == wanted.shape and np.array_equal(values, wanted)
            found[f"{material.name} {part}"] = bool(same)
    assert found
    return found


def wrong():
    return {material.name: texture_repair.wrong_textures(material) for material in bpy.data.materials}


def rules():
    return sorted({f.rule for f in scene_check.check_scene(bpy.context.scene)})


def tell(**found):
    print("FOUND" + json.dumps(found))

"""
PARTS = {f"{name} {part}" for name in ("canvas", "satin") for part in ("table", "sampler", "preview_weights")}


def run(folder: Path, script: str) -> dict[str, Any]:
    """What the script reports, after `MAKE`, in a process of its own."""
    call = [sys.executable, "-P", "-c", MAKE + script, str(folder)]
    done = subprocess.run(call, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    told = [line for line in done.stdout.splitlines() if line.startswith("FOUND")]
    found: dict[str, Any] = json.loads(told[-1].removeprefix("FOUND"))
    return found


@pytest.mark.parametrize("older", ["", "bundle", "blend"])
def test_unpacking_keeps_materials_apart(tmp_path: Path, older: str) -> None:
    """Two packed materials, *Unpack Resources* into //textures/: of bundles, of older ones, of older .blend files."""
    script = f"""
build(bake(older={older == "bundle"}), pack=True)
if {older == "blend"}:
    forget_names()
save()
open_again()
before = {{kind: len(getattr(bpy.data, kind)) for kind in ("images", "node_groups", "materials")}}
bpy.ops.file.unpack_all(method="WRITE_LOCAL")
assert not any(image.packed_file for material in bpy.data.materials for image in textures_of(material).values())
save()
open_again()
tell(right=is_right(), wrong=wrong(), rules=rules(), files=sorted(f.name for f in (folder / "textures").iterdir()))
"""
    found = run(tmp_path, script)
    assert found["right"] == dict.fromkeys(PARTS, True)
    assert found["wrong"] == {"canvas": [], "satin": []} and "wrong_texture" not in found["rules"]
    assert len([file for file in found["files"] if file.startswith(("canvas_", "satin_"))]) == 6


def test_a_moved_project_finds_its_own_files(tmp_path: Path) -> None:
    """Bundles that lie elsewhere now: *Find Missing Files* goes by base names."""
    script = """
save()
build(bake(), pack=False)
save()
moved = folder / "moved" / "deep"
moved.mkdir(parents=True)
for name in ("canvas", "satin"):
    shutil.move(folder / f"{name}.mmat", moved / f"{name}.mmat")
open_again()
bpy.ops.file.find_missing_files(directory=str(folder / "moved"))
save()
open_again()
tell(right=is_right(moved), wrong=wrong(), rules=rules())
"""
    found = run(tmp_path, script)
    assert found["right"] == dict.fromkeys(PARTS, True)
    assert found["wrong"] == {"canvas": [], "satin": []}
    assert not {"wrong_texture", "missing_texture", "common_names"} & set(found["rules"])


def test_another_materials_file_is_told_and_put_right(tmp_path: Path) -> None:
    """Of older bundles *Find Missing Files* takes one for both: panel and check say so, and the fix finds it."""
    script = """
save()
build(bake(older=True), pack=False)
before = rules()
save()
moved = folder / "moved"
moved.mkdir()
for name in ("canvas", "satin"):
    shutil.move(folder / f"{name}.mmat", moved / f"{name}.mmat")
open_again()
bpy.ops.file.find_missing_files(directory=str(moved))
save()
open_again()
swapped, right, after = wrong(), is_right(moved), rules()
save("swapped.blend")
for name in ("canvas", "satin"):
    shutil.move(moved / f"{name}.mmat", folder / f"{name}.mmat")
    shutil.copytree(folder / f"{name}.mmat", moved / f"{name}.mmat")
lost = [is_measured(m) and kinds.BRDF.why_not_rebuildable(m) for m in bpy.data.materials]
scene_check.mend_scene(bpy.context.scene)
paths = [i.filepath for m in bpy.data.materials for i in textures_of(m).values() if Path(i.filepath).suffix]
tell(before=before, swapped=swapped, right=right, after=after, mended=is_right(), left=wrong(), lost=lost, paths=paths)
"""
    found = run(tmp_path, "from measured_materials.addon.material import kinds\n" + script)
    assert "common_names" in found["before"] and "wrong_texture" not in found["before"]
    taken = {f"{name} {part}" for name, parts in found["swapped"].items() for part in parts}
    assert taken and taken == {part for part, right in found["right"].items() if not right}
    assert "wrong_texture" in found["after"]
    assert found["mended"] == dict.fromkeys(PARTS, True) and found["left"] == {"canvas": [], "satin": []}
    assert found["paths"] and all(path.startswith("//") for path in found["paths"])  # the project may move again
    call = [sys.executable, "-P", "-m", "measured_materials", "check", str(tmp_path / "swapped.blend"), "--json"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=120)
    rules = [finding["rule"] for finding in json.loads(done.stdout)["findings"]]
    assert done.returncode == 1 and rules.count("wrong_texture") == len(taken)


def test_a_planted_swap_of_a_packed_texture_is_told(tmp_path: Path) -> None:
    """The size may be the same: only the content shows it. A rebuild does not use it; the fix packs the other."""
    script = """
build(bake(), pack=True)
canvas, satin = (bpy.data.materials[name] for name in ("canvas", "satin"))
other = textures_of(satin)["table"].packed_file.data
table = textures_of(canvas)["table"]
assert not texture_repair.wrong_textures(canvas)
table.pack(data=other, data_len=len(other))
save()
open_again()
canvas = bpy.data.materials["canvas"]
told, why = wrong(), missing_texture(canvas, record_of(canvas), ["table"])
mended = [f.rule for f in scene_check.mend_scene(bpy.context.scene)]
tell(told=told, why=why, mended=mended, right=is_right(), packed=bool(textures_of(canvas)["table"].packed_file))
"""
    found = run(tmp_path, "from measured_materials.addon.material.textures.kept import missing_texture\n" + script)
    assert found["told"] == {"canvas": ["table"], "satin": []} and "another file" in found["why"]
    assert "wrong_texture" in found["mended"] and found["packed"]
    assert found["right"] == dict.fromkeys(PARTS, True)


def test_panels_do_not_hash_at_every_redraw(tmp_path: Path) -> None:
    """Sixteen looks at a material read each file once."""
    script = """
build(bake(), pack=True)
from measured_materials.nodes import texture_content
counted = []
hashing = texture_content.content_of
texture_content.content_of = lambda data: counted.append(len(data)) or hashing(data)
texture_content.forget()
for _ in range(16):
    wrong()
once = len(counted)
scene_check.check_scene(bpy.context.scene)
tell(once=once, anew=len(counted) - once)
"""
    found = run(tmp_path, script)
    assert found["once"] == len(PARTS) and found["anew"] >= 4


def test_textures_made_in_the_blend_are_unpacked_apart(tmp_path: Path) -> None:
    """Names that differ by a sign or a capital, of which some file systems make one."""
    script = """
from measured_materials.nodes.data_image import new_data_image
values = {"a/b": 0.25, "a_b": 0.5, "A_b": 0.75}
for name, value in values.items():
    new_data_image(name, np.full((4, 5, 3), value, np.float32)).use_fake_user = True
save()
open_again()
bpy.ops.file.unpack_all(method="WRITE_LOCAL")
save()
open_again()
files = [bpy.data.images[name].filepath.casefold() for name in values]
tell(right=[bpy.data.images[name].pixels[0] == value for name, value in values.items()], files=files)
"""
    found = run(tmp_path, script)
    assert found["right"] == [True] * 3 and len(set(found["files"])) == 3

"""Install the extension in a real Blender and compare it with the bpy wheel; see check.sh.

Compared are the bake's measured error, which does not depend on chance, and the mean of a small render. What the
application does and the module does not, unpacking, undo and animations by `-a`, is held to what it should be.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import lamps_agree
import leaving
import numpy as np
from application import HERE, Blender
from measured_materials.bake.brdf.preview_sphere import to_srgb
from measured_materials.bake.images.image_io import read_image, write_png
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

BAKE = ["bake", "brdf", "lacquer.binary", "cut.binary", "--resolution", "32", "--out", "out", "--json"]
# Four dimensions, and codes that the shader decodes.
BRUSHED = ["bake", "brdf", "--analytic", "ggx", "alpha=0.1", "alpha_y=0.4", "--storage", "log", "--resolution", "24"]
BRUSHED += ["--out", "out/brushed.mmat", "--json"]
RENDER = ["--exr", "--resolution", "64", "--samples", "64", "--json"]
INSIDE = ("inside", "sampled", "textures", "linked", "undo", "animation", "watch")
# Another arithmetic order under another numpy moves the error in its seventh digit.
SAME_ERROR = 1e-4
# 64 x 64 pixels of 64 samples: means of 4.3, 4.5 and 5.2 lay within 1.5 % of each other; a lost lamp, a black
# material or another table shows as tens of per cent.
SAME_LIGHT = 0.04


def in_wheel(share: Path, arguments: list[str], expect: int = 0) -> dict[str, Any]:
    """The same sub-command in the bpy wheel."""
    command = [sys.executable, "-P", "-m", "measured_materials", *arguments]
    done = subprocess.run(command, cwd=share, capture_output=True, text=True, timeout=300)
    if done.returncode != expect:
        sys.exit(f"check: the wheel gave {done.returncode}\n{done.stderr}")
    return result(done.stdout)


def result(output: str) -> dict[str, Any]:
    """The JSON at the end of the output; Blender itself may have logged something before it."""
    found: dict[str, Any] = json.loads(output[output.index("{\n") :])
    return found


def check(name: str, good: bool, words: str) -> None:
    """Say it, and end where it is not so."""
    print(f"check: {'ok  ' if good else 'FAIL'} {name}: {words}", flush=True)
    if not good:
        sys.exit(1)


def compare_bakes(blender: Blender, share: Path) -> None:
    """One good file and one that is cut short."""
    wheel = in_wheel(share, BAKE, expect=1)
    shutil.rmtree(share / "out")
    real = result(blender.run("--command", "measured_materials", *BAKE, expect=1))
    check("bad file", [e["file"] for e in real["errors"]] == ["cut.binary"], real["errors"][0]["cause"])
    ours, theirs = (found["bundles"][0]["errors"]["rms"] for found in (wheel, real))
    check("bake", abs(ours - theirs) <= SAME_ERROR * ours, f"RMS error {theirs:.6g} 1/sr, the wheel's {ours:.6g}")
    facts = json.loads((share / "out/lacquer.mmat/material.json").read_text())
    expected = {"material.json", "preview.png", *(image["file"] for image in facts["images"].values())}
    names = {file.name for file in (share / "out/lacquer.mmat").iterdir()}
    check("bundle", names == expected, " ".join(sorted(names)))
    text = blender.run("--command", "measured_materials", "inspect", "out/lacquer.mmat")
    check("inspect", f"{facts['table']['basis']} basis" in text, "reports the table")
    result(blender.run("--command", "measured_materials", *BRUSHED))


def compare_renders(blender: Blender, share: Path, name: str, *options: str) -> None:
    """A bundle that the real Blender has baked, in both."""
    call = ["render", f"out/{name}.mmat", "--out", f"out/{name}.png", *RENDER, *options]
    real = result(blender.run("--command", "measured_materials", *call))["mean_linear"]
    check("files", all((share / f"out/{name}.{kind}").stat().st_size for kind in ("png", "exr")), "png and exr")
    wheel = in_wheel(share, call)["mean_linear"]
    worst = max(abs(a / b - 1) for a, b in zip(real, wheel))
    words = f"{name} {' '.join(options)}: mean {real[1]:.4f}, the wheel's {wheel[1]:.4f}, {100 * worst:.1f} % apart"
    check("render", worst <= SAME_LIGHT, words)


def write_felt(folder: Path) -> None:
    """Photographs of bumps under a lamp on an arc."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    brightness, exponent = rng.uniform(0.3, 0.9, (24, 32, 3)), rng.uniform(0.7, 1.5, (24, 32, 3))
    for elevation in (15, 35, 55, 75, 90):
        linear = brightness * np.sin(np.radians(elevation)) ** exponent
        write_png(folder / f"el{elevation}.png", np.rint(to_srgb(linear) * 255).astype(np.uint8))


def inside(blender: Blender, script: str, *arguments: str) -> bool:
    """Run one of the programs beside this; whether it came to its last line, else its words have been said."""
    return f"{script}: all is well" in inside_words(blender, script, *arguments)


def inside_words(blender: Blender, script: str, *arguments: str) -> list[str]:
    """Run one of the programs beside this, and return its lines."""
    return blender.run("--python-exit-code", "9", "--python", f"{script}.py", "--", *arguments).splitlines()


def check_files(blender: Blender, share: Path) -> None:
    """Unpacking, exchanged textures, and libraries that are not there."""
    for name in ("new", "older"):
        words = "two materials of one .blend keep their own pixels, an exchanged file is reported"
        check(f"unpacked, {name} names", inside(blender, "textures", name, name), words)
    for file, rule in (("new/scene.blend", "wrong_texture"), ("new/linked.blend", "missing_library")):
        if rule == "missing_library":
            check("linked", inside(blender, "linked", "new"), "a material of another .blend")
            result(check_blend(blender, file, 0, "--mend"))
            (share / "new/scene.blend").rename(share / "elsewhere.blend")
        found = [finding["rule"] for finding in result(check_blend(blender, file, 1))["findings"]]
        check(f"check of {file}", rule in found, f"exit code 1, {' '.join(found)}")
        if rule == "wrong_texture":
            left = result(check_blend(blender, file, 0, "--mend"))["findings"]
            check(f"mending of {file}", all(f["severity"] != "wrong" for f in left), "exit code 0")


def check_blend(blender: Blender, file: str, expect: int, *options: str) -> str:
    """The output of the sub-command."""
    return blender.run("--command", "measured_materials", "check", file, "--json", *options, expect=expect)


def check_animation(blender: Blender, share: Path) -> None:
    """Its second lamp shines in frame 2 of 3: that picture is the one of the same file with both lamps always there."""
    check("animation", inside(blender, "animation"), "made")
    for name in ("still", "moving", "persistent"):
        told = blender.run(f"{name}.blend", "--python", "watch.py", "--render-anim").splitlines()
        tables = [line.removeprefix("watch: ") for line in told if line.startswith("watch: ")]
        wanted = [f"frame {k} table {2 if name == 'still' or k == 2 else 1} groups [2]" for k in (1, 2, 3)]
        check(f"animation, {name}", tables == wanted, "; ".join(tables))
    second = read_image(share / "still_0002.exr")[..., :3]
    for name in ("moving", "persistent"):
        pictures = [read_image(share / f"{name}_000{k}.exr")[..., :3] for k in (1, 2, 3)]
        same = np.allclose(pictures[1], second, rtol=1e-4, atol=1e-6)
        dark = max(pictures[k].mean() / second.mean() for k in (0, 2))
        words = f"frame 2 is {pictures[1].mean() / second.mean():.6f} of the still's, the others {dark:.2f}"
        check(f"pictures, {name}", same and dark < 0.9, words)


def main(place: Path) -> None:
    """All of it."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        write_merl(share / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        write_merl(share / "flakes.binary", by_name("metallic-paint", flake_alpha=0.3, coat_alpha=0.2))
        (share / "cut.binary").write_bytes((share / "lacquer.binary").read_bytes()[:-8])
        write_felt(share / "felt")
        for name in {*leaving.PROGRAMS, *INSIDE}:
            shutil.copy(HERE / f"{name}.py", share)
        lamps_agree.prepare(share)
        blender = Blender(place, share)
        check("install", True, blender.install())
        compare_bakes(blender, share)
        compare_renders(blender, share, "lacquer")
        compare_renders(blender, share, "lacquer", "--mode", "reference")
        compare_renders(blender, share, "brushed")
        blender.run("--command", "measured_materials", "bake", "brdf", expect=2)
        check("usage", True, "exit code 2")
        check("window", inside(blender, "inside"), "operators, panels, saving, loading")
        told = [line.removeprefix("sampled: ") for line in inside_words(blender, "sampled") if "sampled: " in line]
        check("lamps sampled in the shader", told[-1:] == ["all is well"], "; ".join(told[:-1]))
        for name, good, words in lamps_agree.verdicts(blender, lamps_agree.case_names()):
            check(f"sampled and mirrored, {name}", good, words)
        check("stack of graphs that sample lamps", *lamps_agree.stack(blender))
        check("undo", inside(blender, "undo"), "lamps added, undone and redone in the background")
        check_files(blender, share)
        check_animation(blender, share)
        for verdict in leaving.verdicts(blender, share):
            check(*verdict)


main(Path(sys.argv[1]))

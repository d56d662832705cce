"""Install the extension in a real Blender and compare it with the bpy wheel; see check.sh.

Compared are the bake's measured error, which does not depend on chance, and the mean of a small render.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from application import HERE, Blender
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

BAKE = ["bake", "brdf", "lacquer.binary", "cut.binary", "--resolution", "32", "--out", "out", "--json"]
# Four dimensions, and codes that the shader decodes.
BRUSHED = ["bake", "brdf", "--analytic", "ggx", "alpha=0.1", "alpha_y=0.4", "--storage", "log", "--resolution", "24"]
BRUSHED += ["--out", "out/brushed.mmat", "--json"]
RENDER = ["--exr", "--resolution", "64", "--samples", "64", "--json"]
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
    check("inspect", f"{facts['table']['basis']} basis" in text, "tells the table")
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


def main(place: Path) -> None:
    """All of it."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        write_merl(share / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        (share / "cut.binary").write_bytes((share / "lacquer.binary").read_bytes()[:-8])
        shutil.copy(HERE / "inside.py", share)
        blender = Blender(place, share)
        check("install", True, blender.install())
        compare_bakes(blender, share)
        compare_renders(blender, share, "lacquer")
        compare_renders(blender, share, "lacquer", "--mode", "reference")
        compare_renders(blender, share, "brushed")
        blender.run("--command", "measured_materials", "bake", "brdf", expect=2)
        check("usage", True, "exit code 2")
        lines = blender.run("--python-exit-code", "9", "--python", "inside.py").splitlines()
        check("window", any("inside: all is well" in line for line in lines), "operators, panels, saving, loading")


main(Path(sys.argv[1]))

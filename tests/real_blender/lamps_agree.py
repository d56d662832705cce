"""Are lamps that the shader samples unbiased in a real Blender? `python lamps_agree.py DIR|BLENDER [CASE ...]`.

Each of `lamp_cases` is rendered there with lamps sampled in the shader and with a mirror that meets them, all else
equal, and compared here by t-tests on tiles: a change by 1 % of the picture would be found, and 2 % that are planted
are. Then the largest graphs that sample lamps are held to Cycles' stack, by `stack.py`.
"""

from __future__ import annotations

import ast
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from application import HERE, NO_STACK, Blender

sys.path.insert(1, str(HERE.parent))
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from support.azimuth import clamped_basis, write_azimuth_bundle
from support.monte_carlo import SKEWNESS_LIMIT, compare
from support.swatches import map_bundle, rough_map

PACKAGE = "bl_ext.user_default.measured_materials"
FINDS, LEVEL, PLANTED = 0.01, 1e-3, 1.02
CASES = ("lamp_cases", "world_cases")
PROGRAMS = ("common", *CASES, "stack", "unbiased")
_TOGETHER = 3


def prepare(share: Path) -> None:
    """What `verdicts` and `stack` run and read."""
    for name in PROGRAMS:
        shutil.copy(HERE / f"{name}.py", share)
    swatches(share)


def swatches(share: Path) -> None:
    """A rough canvas lit beyond its brightest photograph, in each model, one over azimuth of the most curves, one whose
    f_r is measured, and those that may let light through too."""
    render = RenderSettings(Lobe("ggx", 0.4), sigma=0.8, above="scale", a_max=0.3)
    for compression in ("none", "power", "basis"):
        map_bundle(share / f"swatch_{compression}", rough_map(), render, compression=compression)
    write_azimuth_bundle(share / "swatch_azimuth", clamped_basis(8, 8, rank=16), render)
    measured = bake_source(
        analytic.Ggx(alpha=0.5, f0=(0.9, 0.6, 0.3)),
        share / "f_r",
        BakeSettings(resolution=16, alpha=(0.5, 0.3), envelope=False),
    )
    stack = PhotoStack(rough_map().slices[1:], tuple("abcde"), None, False, ())
    settings = ArcSettings(
        slices=6, storage=Storage.FLOAT32, brdf=measured.path, render=RenderSettings(None, sigma=1.3)
    )
    bake_stack(stack, share / "swatch_measured", settings)
    # What they let through glitters too, so that both maps need a mirror.
    lit = replace(render, transmission=Lobe("phong", 12.0, 0.4), transmission_sigma=0.4)
    for compression in ("none", "power", "basis"):
        settings = ArcSettings(slices=6, storage=Storage.FLOAT32, compression=compression, render=lit)
        bake_stack(stack, share / f"swatch_{compression}_through", settings, through=stack)
    settings = replace(settings, compression="none", brdf=measured.path, render=replace(lit, lobe=None, a_max=None))
    bake_stack(stack, share / "swatch_measured_through", settings, through=stack)


def case_names() -> list[str]:
    """Keys of CASES in `lamp_cases` and `world_cases`, modules that only Blender can import."""
    trees = [ast.parse((HERE / f"{name}.py").read_text(encoding="utf-8")) for name in CASES]
    found = (n for tree in trees for n in tree.body if isinstance(n, ast.Assign))
    tables = (n.value for n in found if ast.unparse(n.targets[0]) == "CASES")
    return [str(ast.literal_eval(key)) for table in tables for key in table.keys]


def verdicts(blender: Blender, names: list[str]) -> Iterator[tuple[str, bool, str]]:
    """Of each case its name, whether both are the same and noise would not hide it, and figures in words."""
    for first in range(0, len(names), _TOGETHER):
        some = names[first : first + _TOGETHER]
        told = blender.run("--python-exit-code", "9", "--python", "unbiased.py", "--", *some)
        if "no Raycast node" in told:
            return
        for name in some:
            with np.load(blender.share / f"{name}.npz") as found:
                mirrored, sampled, mask = found["mirrored"], found["sampled"], found["mask"]
            result = compare(mirrored, sampled, mask, level=LEVEL)
            planted = compare(mirrored, PLANTED * sampled, mask, level=LEVEL)
            sure = result.skewness < SKEWNESS_LIMIT and result.detectable_effect <= FINDS and not planted.passed
            left = sampled[:, mask].var(0, ddof=1).mean() / mirrored[:, mask].var(0, ddof=1).mean()
            yield name, result.passed and sure, f"{result}; variance {left:.2f} of the mirror's"


def stack(blender: Blender) -> tuple[bool, str]:
    """Whether `stack.py` came to its last line, and what it told; shaders that do not fit are part of its search."""
    probe = (HERE.parent / "support" / "svm_stack.py").read_text(encoding="utf-8")
    ours = f"from {PACKAGE}."
    (blender.share / "svm_stack.py").write_text(probe.replace("from measured_materials.", ours), encoding="utf-8")
    done = blender.headless("--python-exit-code", "9", "--python", "stack.py", "--")
    told = [line.removeprefix("stack: ") for line in done.stdout.splitlines() if line.startswith("stack: ")]
    # Elsewhere the line in the log is an error: here it must be seen, or it would not be seen there either.
    seen = NO_STACK in done.stderr or len(told) == 2
    good = done.returncode == 0 and told[-1:] == ["all is well"] and seen
    return good, "; ".join(told[:-1]) if good else f"{done.stdout[-1500:]}\n{done.stderr[-1500:]}"


def main(place: Path, names: list[str]) -> None:
    """A line for each case; ends with 1 where one is biased, or too noisy to tell."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        prepare(share)
        blender = Blender(place, share)
        print(f"lamps: {blender.install()}", flush=True)
        failed = 0
        for name, good, words in verdicts(blender, names or case_names()):
            print(f"lamps: {'ok  ' if good else 'FAIL'} {name}: {words}", flush=True)
            failed += not good
        good, words = stack(blender)
        print(f"lamps: {'ok  ' if good else 'FAIL'} stack: {words}", flush=True)
        failed += not good
    sys.exit(failed > 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

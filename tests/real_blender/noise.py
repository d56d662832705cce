"""Noise and time of materials whose shader samples light in a real Blender: `python noise.py DIR|BLENDER [NAME ...]`.

Names of lights of `bench engine` and of its materials may follow, `--quiet` for a camera whose lens places draws, and
`--bundles=DIR` for bakes that are kept there, or lie there already.
Scenes, samples and figures are those of `bench engine`, of what nodes can do from Blender 5.1 on: beside a Principled
BSDF of about the same look, and beside a mirror that is aimed at the light.
"""

from __future__ import annotations

import json
import shutil
import statistics
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from application import HERE, Blender

sys.path.insert(1, str(HERE.parent))
sys.path.insert(1, str(HERE.parent / "bench"))
from engine_materials import KINDS, bundle_path
from measured_materials.addon.report.principled_match import fit_principled
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from rich.console import Console
from rich.table import Table

PACKAGE = "bl_ext.user_default.measured_materials"
LIGHTS = ("HDR world", "HDR world and lamp")
USUAL = ("felt", "metallic paint", "phenolic", "bronze", "satin", "flake paint")
VARIANTS = ("aimed", "sampled")


def prepared(share: Path, names: list[str], bundles_in: Path) -> None:
    """Bundles of the materials, what stands for them, and the scenes of `bench engine`, to a folder."""
    kinds = [kind for kind in KINDS if kind.name in names]
    for kind in kinds:
        if not bundle_path(kind, bundles_in).is_dir():
            bake_source(kind.source(share), bundle_path(kind, bundles_in), BakeSettings())
        if bundles_in != share:
            shutil.copytree(bundle_path(kind, bundles_in), bundle_path(kind, share))
    stand_ins = {kind.name: asdict(fit_principled(kind.source(share))) for kind in kinds}
    bundles = {kind.name: bundle_path(kind, share).name for kind in kinds}
    (share / "noise.json").write_text(json.dumps({"bundles": bundles, "stand_ins": stand_ins}), encoding="utf-8")
    scenes = (HERE.parent / "bench" / "engine_scenes.py").read_text(encoding="utf-8")
    (share / "engine_scenes.py").write_text(scenes.replace("from measured_materials.", f"from {PACKAGE}."), "utf-8")
    for name in ("common.py", "noise_inside.py"):
        (share / name).write_text((HERE / name).read_text(encoding="utf-8"), encoding="utf-8")


def report(rows: list[dict[str, object]], console: Console) -> None:
    """Multiples of Principled's, by light and material, and their medians."""
    by_key = {(row["light"], row["material"], row["variant"]): row for row in rows}
    columns = [f"{variant}: {what}" for variant in VARIANTS for what in ("noise", "by pixel", "time", "firefly")]
    table = Table("light", "material", "Principled", *columns, "mean")
    found: dict[str, dict[str, list[float]]] = {}
    for light, material in dict.fromkeys((row["light"], row["material"]) for row in rows):
        base = by_key[light, material, "Principled"]
        cells = []
        for variant in VARIANTS:
            row = by_key[light, material, variant]
            ratios = [float(row[k]) / float(base[k]) for k in ("rms", "local", "seconds")]  # type: ignore[arg-type]
            cells += [f"{ratio:.2f}" for ratio in ratios] + [f"{row['firefly']:.0f}"]
            for what, ratio in zip(("noise", "by pixel", "time"), ratios):
                found.setdefault(str(light), {}).setdefault(f"{variant}: {what}", []).append(ratio)
        means = [float(by_key[light, material, v]["mean"]) for v in VARIANTS]  # type: ignore[arg-type]
        table.add_row(str(light), str(material), f"{base['rms']:.2%}", *cells, f"{means[1] / means[0] - 1:+.1%}")
    console.print(table)
    for light, medians in found.items():
        words = ", ".join(f"{name} {statistics.median(values):.2f}" for name, values in medians.items())
        console.print(f"{light}, medians in parts of Principled's: {words}", soft_wrap=True)


def main(place: Path, words: list[str]) -> None:
    """Print the table."""
    names = [word for word in words if word in {kind.name for kind in KINDS}] or list(USUAL)
    lights = [word for word in words if not word.startswith("--") and word not in names] or list(LIGHTS)
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        kept = [Path(word.removeprefix("--bundles=")) for word in words if word.startswith("--bundles=")]
        prepared(share, names, *(kept or [share]))
        blender = Blender(place, share)
        print(f"noise: {blender.install()}", flush=True)
        rows = []
        for name in names:
            settings = ["--quiet"] * ("--quiet" in words)
            told = blender.run("--python-exit-code", "9", "--python", "noise_inside.py", "--", name, *lights, *settings)
            found = [json.loads(line.removeprefix("noise: ")) for line in told.splitlines() if line[:7] == "noise: "]
            rows += found
            print(f"noise: {name}", flush=True)
            report(found, Console(width=170))
        report(rows, Console(width=170))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

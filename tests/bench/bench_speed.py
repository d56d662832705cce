"""Times of the whole chain: baking, numpy lookups, rendering beside Principled BSDF, and memory, in one run."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sources.analytic import MetallicPaint
from measured_materials.bake.sources.merl import write_merl
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.table import FILTERS
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from record import put
from speed_of_kinds import compare_kinds

# Baking is timed in a process of its own, so that its peak memory is its own.
_BAKE = """
import json, resource, sys, time
started = time.perf_counter()
from measured_materials.bake.brdf.bake import bake_file
from measured_materials.bake.brdf.settings import BakeSettings
result = bake_file(sys.argv[1], sys.argv[2], BakeSettings(filter=sys.argv[3]))
seconds = time.perf_counter() - started
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
print(f"{seconds:.2f} {peak:.0f} {len(result.facts['choice']['candidates'])}")
"""


def run(out: Path, quick: bool) -> None:
    """All four; with --quick shorter renders."""
    with tempfile.TemporaryDirectory() as folder:
        _bake(Path(folder))
    _lookups()
    _samples_per_second(quick)
    compare_kinds(out, principled(), quick)
    print(f"peak memory of this process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB")


def _bake(folder: Path) -> None:
    measurement = folder / "paint.binary"
    write_merl(measurement, MetallicPaint())
    print("MERL file to finished bundle, the bytes of 64 x 64 x 128, basis and parameterisation by error")
    for filter in ("trilinear", "bspline"):
        command = [sys.executable, "-P", "-c", _BAKE, str(measurement), str(folder / filter), filter]
        words = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
        put(f"bake s, {filter}", float(words[0]))
        put(f"bake MB, {filter}", float(words[1]))
        put(f"bake candidates, {filter}", float(words[2]))
        print(f"  {filter:10s} {words[0]:>6s} s  {words[1]:>5s} MB peak  {words[2]} kinds of table compared")


def _lookups() -> None:
    with tempfile.TemporaryDirectory() as folder:
        result = bake_source(MetallicPaint(), Path(folder) / "paint", BakeSettings(alpha=(0.5, 0.1), envelope=False))
        table = BrdfRecord.read(read_bundle(result.path)).load_table()
    pairs = direction_pairs(250_000)
    print("numpy lookups per second, float64 coordinates, one thread of this machine")
    for filter in FILTERS:
        started = time.perf_counter()
        table.evaluate(pairs.wi, pairs.wo, filter)
        print(f"  {filter:10s} {len(pairs.wi) / (time.perf_counter() - started) / 1e6:6.2f} million")


def principled() -> bpy.types.Material:
    """A Principled BSDF that looks about like the paint."""
    values = {"Base Color": (0.1, 0.18, 0.4, 1), "Metallic": 0.8, "Roughness": 0.53}
    values |= {"Coat Weight": 1.0, "Coat Roughness": 0.14}
    return compat.shader_material("Principled", "ShaderNodeBsdfPrincipled", values)


def _samples_per_second(quick: bool) -> None:
    size, samples = (160, 16) if quick else (320, 32)
    with tempfile.TemporaryDirectory() as folder:
        # The modes with native closures are compared by `bench engine`.
        settings = BakeSettings(envelope=False)
        bundle = read_bundle(bake_source(MetallicPaint(), Path(folder) / "paint", settings).path)
        codes = read_bundle(
            bake_source(MetallicPaint(), Path(folder) / "codes", replace(settings, storage=Storage.LOG)).path
        )
        materials = {"Principled": principled()}
        for filter in FILTERS:
            materials[f"{filter}"] = build_material(bundle, filter=filter)
            if filter != "nearest":
                materials[f"{filter}, slices blended"] = build_material(bundle, filter=filter, stochastic=False)
        for words, stochastic in (("", True), (", slices blended", False)):
            materials[f"trilinear, log{words}"] = build_material(codes, stochastic=stochastic)
        times: dict[str, list[float]] = {name: [] for name in materials}
        # Interleaved, so that whatever else the machine does meets all alike; the first round warms up.
        for repeat in range(6 if quick else 4):
            for name, material in materials.items():
                scene = build_studio(material, resolution=(size, size), samples=samples, seed=repeat)
                started = time.process_time()
                render_linear(scene)
                times[name].append(time.process_time() - started)
                remove_studio(scene)
    print("rendering the studio, processor time of a camera sample in ns, and against Principled (Reference mode)")
    seconds = {name: np.array(rounds[1:]) for name, rounds in times.items()}
    for name, mine in seconds.items():
        ns = float(np.median(mine)) / (size * size * samples) * 1e9
        put(f"time, {name}", float(np.median(mine / seconds["Principled"])))
        print(f"  {name:32s} {ns:6.0f}   x {np.median(mine / seconds['Principled']):.2f}")

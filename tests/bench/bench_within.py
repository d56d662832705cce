"""The table that a bake makes within the bytes of a neural network and of an RGL material, beside both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from materials import require_shared, rgl_files
from measured_materials.bake.brdf.part_bake import PartBake
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.neural_brdf import half_and_difference, network
from measured_materials.bake.tables.accuracy import DirectionPairs, direction_pairs
from measured_materials.bake.tables.search.byte_limit import file_bytes
from measured_materials.bake.tables.treated_source import TreatedSource
from record import put, put_range

# An RGL material as its authors publish it, isotropic and RGB, and a network of Sztrajman et al. 2021.
NETWORK_BYTES, RGL_BYTES = 2700, 48 * 1024


def run(out: Path, quick: bool) -> None:
    """The twelve RGL files within the bytes of a neural network and of 48 KiB, beside the network and the file.

    With --quick only within those of the network: 48 KiB take three times as long.
    """
    print("RGL measurements: RMS as a share of the signal's (bytes, shape) of --storage log, of the published network")
    print(
        "of Sztrajman et al. 2021 in the better of its two conventions, and bytes of the file, which is the truth here"
    )
    limits = {NETWORK_BYTES: "network's size", **({} if quick else {RGL_BYTES: f"{RGL_BYTES // 1024} KiB"})}
    print(f"{'':26s}" + "".join(f"{name:>38s}" for name in limits.values()) + f"{'network':>10s}{'RGL, KiB':>10s}")
    shares: dict[str, list[float]] = {}
    for file in rgl_files():
        # Other pairs than those that the bake judges by.
        source, pairs = read_source(file), direction_pairs(65536, offset=0.4)
        line = f"{file.stem:26s}"
        for limit in limits:
            share, size, words = best_within(source, pairs, limit)
            shares.setdefault(f"log, {limit}", []).append(share)
            line += f"{f'{100 * share:.2f} % ({size}, {words})':>38s}"
        shares.setdefault("network", []).append(network_share(source, pairs))
        print(f"{line}{100 * shares['network'][-1]:8.1f} %{file.stat().st_size / 1024:10.0f}", flush=True)
    for name, found in shares.items():
        print(f"median {name}: {100 * np.median(found):.2f} %")
        put(f"RGL share, {name}", float(np.median(found)))
        put_range(f"RGL share, {name}", found)


def best_within(source: BrdfSource, pairs: DirectionPairs, most: int) -> tuple[float, int, str]:
    """Share, bytes and words of the table that a bake makes within so many bytes, the filter left to it."""
    settings = BakeSettings(storage=Storage.LOG, filter="auto", envelope=False, table_bytes=most)
    bake = PartBake(source, settings, lambda stage, share: None, 16384)
    kept = bake.tabulate(bake.choose_grid()[1]).kept
    truth = bake.source.evaluate(pairs.wi, pairs.wo)
    share = pairs.rms(kept.table.evaluate(pairs.wi, pairs.wo) - truth) / pairs.rms(truth)
    return share, file_bytes(kept), f"{'x'.join(map(str, kept.table.grid.shape))} {kept.table.filter}"


def network_share(source: BrdfSource, pairs: DirectionPairs) -> float:
    """RMS of the material's network, given the difference vector of the light or of the viewer, whichever is better."""
    weights = np.load(require_shared() / "data" / "neural_rgl" / "weights.npz")
    layers = [
        tuple(weights[f"{source.name}|dense_{n}|{part}:0"].astype(np.float64) for part in ("kernel", "bias"))
        for n in (1, 2, 3)
    ]
    truth = TreatedSource(source).evaluate(pairs.wi, pairs.wo)
    ways = (pairs.wi, pairs.wo), (pairs.wo, pairs.wi)
    found = [pairs.rms(network(layers, half_and_difference(*way)) - truth) for way in ways]
    return min(found) / pairs.rms(truth)

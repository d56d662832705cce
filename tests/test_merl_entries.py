"""Whether an entry of a MERL file is a bin or a node, and the file's variants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import merl, read_source
from measured_materials.bake.sources.analytic import by_name
from support.bundles import neural_merl

SATIN = by_name("ggx", alpha=0.15, f0=(0.8, 0.5, 0.3))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same BRDF sampled at entries' lower edges and at their centres."""
    folder = tmp_path_factory.mktemp("merl")
    for entries in ("nodes", "bins"):
        merl.write_merl(folder / f"{entries}.binary", SATIN, entries)
    return {entries: folder / f"{entries}.binary" for entries in ("nodes", "bins")}


def pairs(count: int = 20_000) -> tuple[Array, Array]:
    """Pairs below 75 degrees, half of them within a few degrees of the mirror direction."""
    rng = np.random.default_rng(7)
    theta, phi = np.arccos(1 - rng.random((2, count)) * 0.74), rng.random((2, count)) * 2 * np.pi
    wi, wo = spherical(theta[0], phi[0]), spherical(theta[1], phi[1])
    near = wo * [-1, -1, 1] + rng.normal(0, 0.08, wo.shape)
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    return np.where(rng.random((count, 1)) < 0.5, near, wi), wo


def error(source: BrdfSource) -> float:
    """RMS of the difference over RMS of the signal."""
    wi, wo = pairs()
    truth = SATIN.evaluate(wi, wo)
    return float(np.sqrt(np.mean((source.evaluate(wi, wo) - truth) ** 2) / np.mean(truth**2)))


@pytest.mark.parametrize("entries", ["nodes", "bins"])
def test_a_file_tells_what_its_entries_are(entries: str, files: dict[str, Path]) -> None:
    source = read_source(files[entries])
    asymmetry = source.facts["asymmetry_of_readings"]
    assert source.facts["entries_read_as"] == entries and isinstance(asymmetry, dict)
    other = "bins" if entries == "nodes" else "nodes"
    assert asymmetry[entries] < 1e-6 < 1e-3 < asymmetry[other]
    assert error(source) < 0.005
    # The other reading is half a step off, which a lobe of alpha 0.15 shows.
    assert error(read_source(files[entries], Reading(merl=other))) > 0.02


@pytest.mark.parametrize("entries", ["nodes", "bins"])
def test_noise_and_holes_do_not_hide_it(entries: str, files: dict[str, Path], tmp_path: Path) -> None:
    """Noise of 3 %, as a measurement has between its two halves, and a tenth of the entries invalid."""
    data = files[entries].read_bytes()
    planes = np.frombuffer(data[12:]).copy()
    rng = np.random.default_rng(3)
    planes *= 1 + 0.03 * rng.normal(size=planes.shape)
    planes[rng.random(planes.shape) < 0.1] = -1
    (tmp_path / "noisy.binary").write_bytes(data[:12] + planes.tobytes())
    source = read_source(tmp_path / "noisy.binary")
    assert source.facts["entries_read_as"] == entries
    assert error(source) < 0.05


def test_bins_are_as_smooth_at_the_ends_of_their_axes_as_between(files: dict[str, Path]) -> None:
    source = read_source(files["bins"])
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(source.evaluate(up, up), SATIN.evaluate(up, up), rtol=0.01)
    tilted = spherical(0.5, 0.0)
    np.testing.assert_allclose(source.evaluate(tilted, tilted), SATIN.evaluate(tilted, tilted), rtol=0.02)
    low = spherical(np.radians(85.0), 0.0)
    assert (source.evaluate(low, low * [-1, 1, 1]) > 0).all()
    wi, wo = pairs(2000)
    np.testing.assert_allclose(source.evaluate(wi, wo), source.evaluate(wo, wi), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("order", "kind"), [("<", "f4"), (">", "f8"), (">", "f4")])
def test_other_numbers_give_the_same_material(order: str, kind: str, files: dict[str, Path], tmp_path: Path) -> None:
    planes = np.frombuffer(files["bins"].read_bytes()[12:])
    head = np.array([90, 90, 180], f"{order}i4").tobytes()
    (tmp_path / "x.binary").write_bytes(head + planes.astype(f"{order}{kind}").tobytes())
    source = read_source(tmp_path / "x.binary")
    assert "endian float" in str(source.facts["numbers"])
    wi, wo = pairs(2000)
    np.testing.assert_allclose(source.evaluate(wi, wo), read_source(files["bins"]).evaluate(wi, wo), rtol=1e-5)


def test_a_whole_turn_of_phi_d_is_folded_and_its_difference_told(files: dict[str, Path], tmp_path: Path) -> None:
    half = np.frombuffer(files["bins"].read_bytes()[12:]).reshape(3, 90, 90, 180)
    # One half 20 % brighter than the other, where both are valid: light and viewer cannot be exchanged.
    whole = np.concatenate([np.where(half > 0, half * 1.1, half), np.where(half > 0, half * 0.9, half)], -1)
    (tmp_path / "x.binary").write_bytes(np.array([90, 90, 360], "<i4").tobytes() + whole.tobytes())
    source = read_source(tmp_path / "x.binary")
    np.testing.assert_allclose(source.facts["reciprocity_error"], 0.2, rtol=1e-6)
    wi, wo = pairs(2000)
    np.testing.assert_allclose(source.evaluate(wi, wo), read_source(files["bins"]).evaluate(wi, wo), rtol=1e-5)


def test_numbers_of_the_other_byte_order_are_refused(files: dict[str, Path], tmp_path: Path) -> None:
    data = files["bins"].read_bytes()
    (tmp_path / "x.binary").write_bytes(np.array([90, 90, 180], ">i4").tobytes() + data[12:])
    with pytest.raises(BakeError, match="byte order"):
        read_source(tmp_path / "x.binary")


def test_networks_trained_on_lower_edges_give_bins_back(shared_tools: Path, tmp_path: Path) -> None:
    """Neural-BRDF was trained on MERL's entries as if they were nodes. Its reconstruction of an entry is that entry: it
    pairs as the measurement's own do, as bins, if only by some per cent of the networks' own asymmetry.
    """
    tool = neural_merl(shared_tools)
    for name in ("blue-rubber", "silver-paint", "polyethylene"):
        tool.write(name, tmp_path / "x.binary")
        assert read_source(tmp_path / "x.binary").facts["entries_read_as"] == "bins"
    tool._W.close()  # the tool keeps its archive open, which pytest would report

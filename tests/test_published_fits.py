"""Published parameter sets: the formulas beside scalar ones, beside networks of the same measurements; files, names."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli import bake_brdf
from measured_materials.addon.plots.brdf_plots import draw_brdf
from measured_materials.bake.brdf.bake import bake_file
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.origin import file_origin, is_same
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array
from measured_materials.bake.sources import chosen_material, read_source, title_of
from support.coarse_bakes import coarse  # noqa: F401
from support.format_files import ABC_SET, SGD_SET, pairs, write_published
from support.networks import network_values


def scalar_sgd(wi: Array, wo: Array, p: dict[str, Any], c: int) -> float:
    """As dj_brdf has it, one channel of one pair."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    cos_d, theta_h = float(wi @ half), math.acos(min(half[2], 1.0))

    def shadow(cosine: float) -> float:
        power = max(0.0, math.acos(cosine) - p["theta0"][c]) ** p["k"][c]
        return min(max(1 + p["lambda"][c] * (1 - math.exp(p["c"][c] * power)), 0.0), 1.0)

    fresnel = p["f0"][c] - cos_d * p["f1"][c] + (1 - cos_d) ** 5 * (1 - p["f0"][c])
    x = p["alpha"][c] + math.tan(theta_h) ** 2 / p["alpha"][c]
    spread = p["kap"][c] * math.exp(-x) / (math.pi * x ** p["p"][c] * half[2] ** 4)
    lobe = p["rhoS"][c] * fresnel * spread * shadow(wi[2]) * shadow(wo[2]) / (wi[2] * wo[2])
    return float((p["rhoD"][c] + lobe) / math.pi)


def scalar_abc(wi: Array, wo: Array, p: dict[str, Any], c: int) -> float:
    """As dj_brdf has it."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    cos_d, n = float(wi @ half), p["ior"]
    cos_t = math.sqrt(1 - (1 - cos_d**2) / n**2)
    r_s, r_p = (cos_d - n * cos_t) / (cos_d + n * cos_t), (cos_t - n * cos_d) / (cos_t + n * cos_d)
    spread = p["A"][c] / (1 + p["B"] * (1 - half[2])) ** p["C"]
    shadow = min(1, 2 * half[2] * wi[2] / cos_d, 2 * half[2] * wo[2] / cos_d)
    return float(p["kD"][c] / math.pi + (r_s**2 + r_p**2) / 2 * spread * shadow / (math.pi * wi[2] * wo[2]))


@pytest.mark.parametrize(("entries", "scalar"), [(SGD_SET, scalar_sgd), (ABC_SET, scalar_abc)], ids=["SGD", "ABC"])
def test_a_set_is_evaluated_as_its_formula(entries: dict[str, Any], scalar: Any, tmp_path: Path) -> None:
    source = read_source(write_published(tmp_path / "fit.json", entries=entries))
    wi, wo = pairs(100, 80)
    expected = [[scalar(a, b, entries, c) for c in range(3)] for a, b in zip(wi, wo, strict=True)]
    np.testing.assert_allclose(source.evaluate(wi, wo), expected, rtol=1e-6)
    assert source.isotropic and source.name == "fit"


def test_all_published_sets_are_finite_up_to_the_horizon(shared_data: Path) -> None:
    theta = np.radians([0.0, 1e-4, 10.0, 45.0, 80.0, 89.0, 89.9999])
    ti, to, phi = np.meshgrid(theta, theta, np.radians([0.0, 90.0, 179.0, 180.0]), indexing="ij")
    wi, wo = spherical(ti, 0.0), spherical(to, phi)
    for name in ("merl_sgd_bagher2012", "merl_abc_low2012"):
        path = shared_data / "published_fits" / f"{name}.json"
        materials = json.loads(path.read_text())["materials"]
        assert len(materials) == 100
        for material in materials:
            value = read_source(path, Reading(material=material)).evaluate(wi, wo)
            assert np.isfinite(value).all(), (name, material)


def test_fits_are_near_the_networks_of_the_same_measurements(shared_data: Path) -> None:
    """A missing pi or a factor of 4 would show as a ratio; both fits are rough, the median is not."""
    weights = np.load(shared_data / "neural_merl" / "weights.npz")
    wi, wo = pairs(400, 60)
    compared = {"merl_sgd_bagher2012": [], "merl_abc_low2012": []}  # type: dict[str, list[float]]
    for name, ratios in compared.items():
        path = shared_data / "published_fits" / f"{name}.json"
        for material in json.loads(path.read_text())["materials"]:
            if f"{material}/fc1" in weights and len(ratios) < 25:
                found = read_source(path, Reading(material=material)).evaluate(wi, wo)
                ratios.append(float(np.median(found / np.maximum(network_values(weights, material, wi, wo), 1e-4))))
    for name, ratios in compared.items():
        assert len(ratios) >= 20
        print(name, np.percentile(ratios, [10, 50, 90]))
        assert 0.8 < np.median(ratios) < 1.25, (name, ratios)


def _several(path: Path) -> Path:
    sets = {"Alum Bronze": SGD_SET | {"otherName": "bronze-alu"}, "blue-rubber": ABC_SET, "red-rubber": ABC_SET}
    path.write_text(json.dumps({"source": "a test", "materials": sets}))
    return path


def test_one_of_several_materials_is_chosen_by_either_name(tmp_path: Path) -> None:
    path = _several(tmp_path / "merl.json")
    for name in ("alum-bronze", "Alum_Bronze", "BRONZE-ALU"):
        source = read_source(path, Reading(material=name))
        assert source.name == "Alum Bronze" and source.facts["also_called"] == "bronze-alu"
    with pytest.raises(BakeError, match="holds 3 materials: Alum Bronze, blue-rubber, red-rubber; choose one"):
        read_source(path)
    with pytest.raises(BakeError, match="no material 'blue-rubbr'; choose one of its 3, such as blue-rubber"):
        read_source(path, Reading(material="blue-rubbr"))


def test_materials_of_one_file_are_different_bakes(tmp_path: Path) -> None:
    path = _several(tmp_path / "merl.json")
    blue, red = file_origin(path, "blue-rubber"), file_origin(path, "red-rubber")
    assert is_same(blue, dict(blue)) and not is_same(blue, red)
    settings = BakeSettings(resolution=8, envelope=False, reading=Reading(material="blue-rubber"))
    result = bake_file(path, tmp_path / "blue.mmat", settings)
    told: Any = result.facts["source"]
    assert told["material"] == "blue-rubber" and told["name"] == "blue-rubber"
    kept: Any = result.facts["settings"]
    assert kept["reading"] == {"material": "blue-rubber"}
    assert title_of(path, settings.reading) == "blue-rubber" and title_of(path, Reading()) == "merl"


@pytest.mark.parametrize("spelt", ["Alum Bronze", "alum-bronze", "BRONZE_ALU"])
def test_a_material_is_the_same_however_it_is_spelt(spelt: str, tmp_path: Path) -> None:
    path = _several(tmp_path / "merl.json")
    settings = BakeSettings(resolution=8, envelope=False, reading=Reading(material=spelt))
    told: Any = bake_file(path, tmp_path / "bronze.mmat", settings).facts["source"]
    assert told["material"] == title_of(path, settings.reading) == "Alum Bronze"
    assert is_same(told, file_origin(path, "Alum Bronze"))


def test_a_material_is_chosen_of_no_other_format(tmp_path: Path) -> None:
    """Neither name nor origin of a file of one material depends on it."""
    path = tmp_path / "grey.npy"
    np.save(path, np.full((3, 3, 4, 3), 0.2))
    chosen = BakeSettings(resolution=8, envelope=False, reading=Reading(material="gold"))
    made: Any = bake_file(path, tmp_path / "a.mmat", chosen).facts
    plain: Any = bake_file(path, tmp_path / "b.mmat", replace(chosen, reading=Reading())).facts
    assert made["source"] == plain["source"] and made["settings"] == plain["settings"]
    assert title_of(path, chosen.reading) == "grey"
    two = argparse.Namespace(files=[tmp_path / "a.binary", tmp_path / "b.binary"], analytic=[])
    assert [job.stem for job in bake_brdf._jobs(two, chosen.reading)[0]] == ["a", "b"]
    one = write_published(tmp_path / "one.json", entries=SGD_SET)
    assert title_of(one, Reading()) == "one" and chosen_material(one, Reading(material="A_Material")) == ""


def test_a_name_in_a_file_becomes_no_path(tmp_path: Path) -> None:
    path = tmp_path / "merl.json"
    path.write_text(json.dumps({"materials": {"../../evil": SGD_SET, "...": SGD_SET}}))
    assert (
        title_of(path, Reading(material="../../evil")) == "_.._evil"
        and title_of(path, Reading(material="...")) == "merl"
    )
    inside = tmp_path / "deep" / "figures"
    inside.mkdir(parents=True)
    source = read_source(path, Reading(material="../../evil"))
    made = draw_brdf(source, {"measurement": source}, source.name, inside)
    assert sorted(tmp_path.rglob("*.png")) == sorted(made) and {figure.parent for figure in made} == {inside}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"kD": [1, 2, 3], "A": [1, 1, 1], "B": 1, "C": 1, "ior": "x"}', "no ior that is a number"),
        ('{"kD": [1, 2], "A": [1, 1, 1], "B": 1, "C": 1, "ior": 1.5}', "no kD that is three numbers"),
        ('{"kD": [1, 2, NaN], "A": [1, 1, 1], "B": 1, "C": 1, "ior": 1.5}', "no kD that is three numbers"),
        ('{"kD": [1, 2, true], "A": [1, 1, 1], "B": 1, "C": 1, "ior": 1.5}', "no kD that is three numbers"),
        ('{"materials": {"a": {"kD": 1}}, "x": "kD A B C ior"}', "neither SGD nor ABC"),
        ('{"materials": {}}', "lists no materials"),
        ('{"materials": {"a": 3}}', "no object of parameters"),
        ('{"kD": [1, 2, 3', "is not valid JSON"),
        ("[" * 100_000, "nested too deeply"),
        ('{"materials": {"a": ' + '{"a":' * 50_000, "nested too deeply|not valid JSON"),
    ],
)
def test_damaged_sets_are_refused_with_their_reason(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(BakeError, match=says):
        read_source(tmp_path / "fit.json")

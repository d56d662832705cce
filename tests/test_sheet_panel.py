"""What panel, scene check and queue know of a sheet that lets light through; nothing is rendered."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest
from measured_materials.addon.lights import aim_targets
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.rebuild import rebuild_brdf
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources.analytic import ThinCloth
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.scenes import TestScene, lit_sphere
from test_addon import registered  # noqa: F401

CLOTH = ThinCloth((0.1, 0.1, 0.1), (0.3, 0.2, 0.1), (0.2, 0.2, 0.1), (0.4, 0.4, 0.4), 8.0)
SETTINGS = BakeSettings(resolution=8, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> BakeResult:
    return bake_source(CLOTH, tmp_path_factory.mktemp("cloth") / "cloth", SETTINGS)


@pytest.fixture
def cloth(baked: BakeResult, tmp_path: Path, registered: None) -> bpy.types.Material:  # noqa: F811
    path = Path(shutil.copytree(baked.path, tmp_path / "cloth.mmat"))
    return material_from(BakeResult(path, baked.facts, 0.0), pack=True)


@pytest.fixture
def scene(cloth: bpy.types.Material) -> Iterator[TestScene]:
    with lit_sphere(cloth, 24, resolution=8) as made:
        made.leave_terminator()
        update_scene(made.scene)
        yield made


def rules(scene: TestScene) -> set[str]:
    return {finding.rule for finding in check_scene(scene.scene) or ()}


@pytest.mark.parametrize("shader, mode", [("nodes", "exact"), ("osl", "exact"), ("osl", "balanced")])
def test_the_scene_check_asks_no_sheet_to_sample_lamps(
    cloth: bpy.types.Material, scene: TestScene, shader: str, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither where nodes could, nor where all was to be built as scripts: fitting it again would change nothing."""
    monkeypatch.setattr(aim_targets, "can_raycast", lambda: True)
    rebuild_brdf(cloth, Choices(mode=mode, shader=shader), scene.scene)
    assert not rules(scene) & {"not_sampled", "not_aimed"}

"""What `bench sample-time` takes away of the shader: that it stands there."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(1, str(Path(__file__).parent / "bench"))

from bench_sample_time import CUTS, cut
from measured_materials.nodes.osl_material import SHADER
from measured_materials.nodes.osl_script import shader_source


def test_every_part_is_taken_out_of_the_shader() -> None:
    whole = shader_source(SHADER)
    texts = [cut(steps) for steps in range(len(CUTS) + 1)]
    assert texts[0] == whole and len(set(texts)) == len(texts)
    for _, old, _ in CUTS:
        assert whole.count(old) == 1


def test_a_part_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench_sample_time.CUTS", (("a part", "no such text", ""),))
    with pytest.raises(ValueError, match="a part"):
        cut(1)

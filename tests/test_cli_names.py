"""Names that commands derive: nothing of another source is replaced without a word."""

from __future__ import annotations

from pathlib import Path

import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.bundle.origin import refuse_another
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from support.coarse_bakes import coarse  # noqa: F401
from support.stacks import write_stack

QUICK = ["--resolution", "8", "--alpha", "0.5,0.5", "--no-envelope"]


def test_another_source_does_not_replace_a_bundle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A TD runs over a library: the same source again replaces its bundle, another of that name is refused."""
    out = ["--out", str(tmp_path / "baked"), *QUICK]
    bundle = tmp_path / "baked" / "gold.mmat"
    files = []
    for k, alpha in enumerate((0.3, 0.5)):
        files.append(tmp_path / str(k) / "gold.binary")
        files[-1].parent.mkdir()
        write_merl(files[-1], by_name("ggx", alpha=alpha))
    assert main(["bake", "brdf", str(files[0]), *out]) == 0
    first = (bundle / "material.json").read_bytes()
    capsys.readouterr()
    assert main(["bake", "brdf", str(files[1]), "--analytic", "lambert", *out]) == 1
    printed = capsys.readouterr()
    errors = [line for line in printed.err.splitlines() if line.startswith("measured_materials: ")]
    assert len(errors) == 1 and "gold.mmat" in errors[0] and "is not replaced" in errors[0]
    assert "--out NAME.mmat" in errors[0] and "--replace" in errors[0]
    assert (bundle / "material.json").read_bytes() == first
    assert (tmp_path / "baked" / "lambert.mmat").is_dir()  # the others are baked
    assert main(["bake", "brdf", str(files[1]), "--replace", *out]) == 0
    second = (bundle / "material.json").read_bytes()
    assert main(["bake", "brdf", str(files[1]), *out, "--resolution", "10"]) == 0  # the same source, as ever
    assert len({first, second, (bundle / "material.json").read_bytes()}) == 3
    for model, code in (("lambert", 0), ("lambert diffuse=0.2", 1), ("lambert diffuse=0.5", 0)):
        assert main(["bake", "brdf", "--analytic", *model.split(), *out]) == code, model
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(bundle), *QUICK]) == 1


def test_a_source_is_read_for_comparison_only_where_a_bundle_is(tmp_path: Path) -> None:
    """Forty photographs of 100 MB would be read once more for nothing."""
    refuse_another(tmp_path / "new.mmat", lambda: pytest.fail("read without need"))
    (tmp_path / "old.mmat").mkdir()
    (tmp_path / "old.mmat" / "material.json").write_text('{"source": {"name": "felt"}}')
    refuse_another(tmp_path / "old.mmat", lambda: {"name": "felt", "sha256": "0"})
    with pytest.raises(BakeError, match="give another --out"):
        refuse_another(tmp_path / "old.mmat", lambda: {"name": "denim", "sha256": "0"})


def test_two_inputs_of_one_name_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where only some file systems would take the names for one."""
    paths = [str(tmp_path / "a" / "Über.binary"), str(tmp_path / "b" / "U\u0308ber.binary")]
    formulas = ["--analytic", "ggx", "alpha=0.1", "--analytic", "ggx", "alpha=0.3"]
    for inputs in (paths, formulas):
        assert main(["bake", "brdf", *inputs, "--out", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and "two inputs would become" in error and "--out OTHER.mmat" in error
    assert not list(tmp_path.iterdir())


def test_render_replaces_its_own_pictures_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("bpy")
    monkeypatch.chdir(tmp_path)
    assert main(["bake", "brdf", "--analytic", "lambert", *QUICK]) == 0
    render = ["render", "lambert.mmat", "--resolution", "16", "--samples", "1"]
    mine = tmp_path / "lambert.png"
    mine.write_bytes(b"a photograph of Lambert")
    capsys.readouterr()
    assert main(render) == 1
    error = capsys.readouterr().err
    assert "lambert.png: is there already" in error and "--out" in error
    assert mine.read_bytes() == b"a photograph of Lambert"
    assert main([*render, "--replace"]) == 0
    assert main(render) == 0  # its own
    twin = tmp_path / "lambert.exr"
    twin.write_bytes(b"a room")
    assert main([*render, "--exr"]) == 1  # the picture is its own, what lies beside it is not
    assert twin.read_bytes() == b"a room"
    assert main([*render, "--exr", "--replace"]) == main(render) == main([*render, "--exr"]) == 0
    (tmp_path / "sky.exr").write_bytes(b"light")
    for further in ([], ["--environment", "sky.exr"]):
        capsys.readouterr()
        assert main([*render, "--exr", "--out", "sky.png", *further]) == 1
        error = capsys.readouterr().err
        assert "sky.exr" in error and "replace" in error
    assert main([*render, "--exr", "--out", "sky.png", "--environment", "sky.exr", "--replace"]) == 1
    assert "is the environment" in capsys.readouterr().err
    assert (tmp_path / "sky.exr").read_bytes() == b"light"


def test_another_stack_does_not_replace_a_shading_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two folders of one name; the same photographs again, and a plot that would be one of them."""
    stacks = [write_stack(tmp_path / str(k) / "felt", size=size) for k, size in enumerate(((20, 16), (22, 16)))]
    out = ["--out", str(tmp_path), "--size", "0"]
    assert main(["bake", "arc", str(stacks[0]), *out]) == 0
    assert main(["bake", "arc", str(stacks[0]), *out, "--slices", "4"]) == 0
    before = (tmp_path / "felt.mmat" / "material.json").read_bytes()
    capsys.readouterr()
    assert main(["bake", "arc", str(stacks[1]), *out]) == 1
    assert "felt.mmat: holds a bake of another 'felt' and is not replaced" in capsys.readouterr().err
    assert (tmp_path / "felt.mmat" / "material.json").read_bytes() == before
    assert main(["bake", "arc", str(stacks[1]), *out, "--replace"]) == 0
    photograph = next(path for path in stacks[0].iterdir() if path.suffix == ".png")
    content = photograph.read_bytes()
    assert main(["bake", "arc", str(stacks[0]), *out, "--replace", "--plot", str(photograph)]) == 2
    assert "would be replaced" in capsys.readouterr().err and photograph.read_bytes() == content

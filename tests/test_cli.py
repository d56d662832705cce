"""The command line: results, bad input, interruption, and JSON that is nothing but JSON."""

from __future__ import annotations

import io
import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.console.result import Result
from measured_materials.addon.cli.main import _tell, main
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.sources.merl import DIMENSIONS
from support.coarse_bakes import coarse  # noqa: F401

# A small table with a given alpha bakes in about a second.
QUICK = ["--resolution", "8", "--alpha", "0.5,0.5", "--no-envelope"]
ENTRIES = 3 * int(np.prod(DIMENSIONS))


@pytest.fixture(scope="module")
def bundle(measurement: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bundle")
    paper = ["--basis", "normal", "--parameterization", "bezier"]
    assert main(["bake", "brdf", str(measurement), "--out", str(folder), "--resolution", "8", *paper]) == 0
    return folder / "lacquer.mmat"


def command(*arguments: str | Path, before: str = "", **options: Any) -> subprocess.CompletedProcess[str]:
    """The command line as a process of its own; `before` is Python code run first."""
    code = f"{before}\nfrom measured_materials.addon.cli.main import main\nimport sys\nsys.exit(main())"
    start = [sys.executable, "-P", "-c", code] if before else [sys.executable, "-P", "-m", "measured_materials"]
    return subprocess.run([*start, *map(str, arguments)], capture_output=True, text=True, timeout=120, **options)


# --- bake -------------------------------------------------------------------------------------------------


def test_bakes_files_and_models_together(measurement: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    models = ["--analytic", "lambert", "diffuse=0.1,0.2,0.3", "--analytic", "ward", "variant=duer", "alpha=0.4"]
    out = tmp_path / "made" / "here"
    assert main(["bake", "brdf", str(measurement), *models, "--out", str(out), *QUICK]) == 0
    printed = capsys.readouterr()
    assert len(printed.out.splitlines()) == 3 and "RMS" in printed.out
    assert "3/3 ward: preparing directions" in printed.err
    lambert = read_bundle(out / "lambert.mmat").material
    # A Lambert table returns its albedo; half floats keep 11 bits, and the quadrature 5e-5.
    np.testing.assert_allclose(lambert["albedo"]["white_sky"], (0.1, 0.2, 0.3), rtol=6e-4)
    assert read_bundle(out / "ward.mmat").material["source"]["facts"]["variant"] == "duer"
    assert read_bundle(out / "lacquer.mmat").material["source"]["file"] == measurement.name


def test_out_names_one_bundle(tmp_path: Path) -> None:
    """In a folder that is made for it, as for several: a bake of minutes would have nowhere to go."""
    target = tmp_path / "made" / "here" / "mine.MMAT"
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(target), *QUICK]) == 0
    assert read_bundle(target).material["source"]["name"] == "lambert"


def test_settings_reach_the_bundle(tmp_path: Path) -> None:
    options = "--resolution 6 --parameterization uniform --storage rgbe --filter bspline --spline plain".split()
    options += ["--sampler", "16"]
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(tmp_path), *options]) == 0
    bundle = read_bundle(tmp_path / "lambert.mmat")
    settings = bundle.material["settings"]
    assert {key: bundle.material["sampler"][key] for key in ("n_o", "n_h", "n_phi")} == {
        "n_o": 16,
        "n_h": 16,
        "n_phi": 8,
    }
    wanted = {"resolution": 6, "parameterization": "uniform", "storage": "rgbe", "filter": "bspline"}
    assert settings.items() >= (wanted | {"spline": "plain"}).items()


@pytest.mark.parametrize(
    "arguments, word",
    [
        ("bake brdf", "nothing to bake"),
        ("bake brdf x.binary --resolution 3", "--resolution"),
        ("bake brdf x.binary --resolution x", "--resolution"),
        ("bake brdf x.binary --alpha 0.5", "neither error nor intensity"),
        ("bake brdf x.binary --alpha 2,0", "two numbers in [0, 1]"),
        ("bake brdf x.binary --alpha nan,0", "two numbers in [0, 1]"),
        ("bake brdf x.binary --storage jpeg", "invalid choice"),
        ("bake brdf x.binary --storage byte", "invalid choice"),
        ("bake brdf x.binary --sampler 5", "invalid choice"),
        ("bake arc x --storage log", "invalid choice"),
        ("bake brdf a.binary b.binary --out x.mmat", "names one bundle"),
        ("bake brdf a/x.binary b/X.binary", "two inputs would become"),
        ("bake brdf --analytic ggx 0.3", "KEY=VALUE"),
        ("render x.mmat --samples 0", "--samples"),
        ("bake", "KIND"),
        ("", "COMMAND"),
        ("paint", "invalid choice"),
    ],
)
def test_wrong_usage(
    arguments: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    printed = capsys.readouterr()
    assert word in printed.err and not printed.out
    assert not list(tmp_path.iterdir())


def test_help_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["bake", "brdf", "--help"], ["inspect", "-h"], ["render", "-h"], ["demo", "-h"]):
        assert main(arguments) == 0
        assert "usage: measured_materials" in capsys.readouterr().out


# --- bad input --------------------------------------------------------------------------------------------


def merl_bytes(values: np.ndarray | None = None, header: tuple[int, int, int] = DIMENSIONS) -> bytes:
    body = np.full(ENTRIES, 0.5) if values is None else values
    return struct.pack("<3i", *header) + body.astype("<f8").tobytes()


def nan_values() -> np.ndarray:
    return np.full(ENTRIES, np.nan)


BAD: dict[str, tuple[str, Callable[[], bytes]]] = {
    "empty": ("x.binary", lambda: b""),
    "truncated": ("x.binary", lambda: merl_bytes()[:-8]),
    "header alone": ("x.binary", lambda: merl_bytes()[:12]),
    "oversized": ("x.binary", lambda: merl_bytes() + bytes(8)),
    "other dimensions": ("x.binary", lambda: merl_bytes(header=(90, 90, 181))),
    "negative dimensions": ("x.binary", lambda: merl_bytes(header=(-90, -90, 180))),
    "all negative": ("x.binary", lambda: merl_bytes(np.full(ENTRIES, -1.0))),
    "all zero": ("x.binary", lambda: merl_bytes(np.zeros(ENTRIES))),
    "all NaN": ("x.binary", lambda: merl_bytes(nan_values())),
    "tensor file of a billion fields": (
        "x.bsdf",
        lambda: b"tensor_file\0\1\0" + struct.pack("<I", 1 << 30) + bytes(99),
    ),
    "tensor file of huge extents": (
        "x.bsdf",
        lambda: b"tensor_file\0\1\0" + struct.pack("<IH3sHBQ2Q", 1, 3, b"rgb", 2, 10, 64, 1 << 62, 1 << 62),
    ),
    "text": ("x.brdf.txt", lambda: b"not a measurement\n"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_measurement_is_one_line_and_leaves_nothing(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = BAD[case]
    file, out = tmp_path / name, tmp_path / "out"
    file.write_bytes(content())
    # Otherwise the tests of one run would hold half a gigabyte of files at a time.
    try:
        assert main(["bake", "brdf", str(file), "--out", str(out), *QUICK]) == 1
        baked = capsys.readouterr()
        code = main(["inspect", str(file)])
        inspected = capsys.readouterr()
    finally:
        file.unlink()
    complaints = [line for line in baked.err.splitlines() if line.startswith("measured_materials: ")]
    assert len(complaints) == 1 and name in complaints[0] and "; " in complaints[0]
    assert "Traceback" not in baked.err and not baked.out
    assert not out.exists()
    # What cannot be baked may still be worth a look: all zeros are a well-formed file.
    assert code == 1 or case == "all zero"
    assert len(inspected.err.splitlines()) == code


def test_others_are_baked_after_a_bad_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bake", "brdf", str(tmp_path / "absent.binary"), "--analytic", "lambert", "--analytic", "gold"]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--json", *QUICK]) == 1
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert [Path(each["path"]).name for each in found["bundles"]] == ["lambert.mmat"]
    assert {Path(each["file"]).name for each in found["errors"]} == {"absent.binary", "analytic gold"}
    assert all(each["cause"] and each["remedy"] for each in found["errors"])
    assert sum(line.startswith("measured_materials: ") for line in printed.err.splitlines()) == 2


def test_line_breaks_in_a_name_stay_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(tmp_path / "a\nb\x1b[2J.binary")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.skipif(os.name == "nt" or getattr(os, "geteuid", lambda: 1)() == 0, reason="permissions do not bind here")
def test_folder_without_permission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tmp_path.chmod(0o500)
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(tmp_path / "out"), *QUICK]) == 1
    assert "cannot be made" in capsys.readouterr().err


def test_out_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("mine")
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(tmp_path / "out"), *QUICK]) == 1
    assert "cannot be made" in capsys.readouterr().err
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(tmp_path / "out" / "a.mmat"), *QUICK]) == 1
    assert "cannot be made" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"


# --- inspect ----------------------------------------------------------------------------------------------


def test_inspect_bundle(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(bundle)]) == 0
    text = capsys.readouterr().out
    for word in (
        "lacquer",
        "MERL",
        "8 x 8 x 16, normal basis, bezier",
        "least error",
        "Intensity",
        "RMS error",
        "while rendering",
    ):
        assert word in text
    assert main(["inspect", str(bundle / "material.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    table = found["sizes"]["table"]
    assert table["file_bytes"] == (bundle / found["images"]["table"]["file"]).stat().st_size
    assert table["render_bytes"] == table["width"] * table["height"] * 8  # half RGB, padded to RGBA
    assert found["search"]["by_error"]["rms"] <= found["search"]["by_intensity"]["rms"]


def test_inspect_tells_what_else_could_have_been_chosen(
    measurement: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By default a glossy material goes into the half-vector basis, and the rivals' errors stand beside it."""
    out = ["--out", str(tmp_path), "--resolution", "12", "--no-envelope"]
    assert main(["bake", "brdf", str(measurement), *out]) == 0
    capsys.readouterr()
    assert main(["inspect", str(tmp_path / "lacquer.mmat")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("Table ") and "half basis, " in line for line in lines)
    (rivals,) = [line for line in lines if line.startswith("RMS of other grids")]
    assert all(name in rivals for name in ("normal fitted", "normal uniform", "half squared", "half uniform"))
    assert main(["bake", "brdf", str(measurement), *out, "--basis", "half", "--alpha", "0.5,0.5"]) == 2


def test_inspect_measurement(measurement: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(measurement), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["name"], found["isotropic"]) == ("MERL", "lacquer", True)
    assert found["facts"]["invalid"] == [0, 0, 0]
    assert found["errors"] == []
    assert main(["inspect", str(measurement)]) == 0
    assert "Invalid" in capsys.readouterr().out


@pytest.mark.parametrize(
    "change",
    [
        lambda facts: facts.pop("table"),
        lambda facts: facts.update(errors=[]),
        lambda facts: facts["errors"].update(rms="none"),
        lambda facts: facts["albedo"].update(directional=[]),
        lambda facts: facts["albedo"].update(above_one_deg=7),
        lambda facts: facts["search"].pop("by_intensity"),
        lambda facts: facts.update(settings=None),
        lambda facts: facts.update(schema=99),
        lambda facts: facts["images"]["table"].update(file="../table.exr"),
        lambda facts: (facts.clear(), facts.update(kind="brdf")),
    ],
)
def test_inspect_damaged_bundle_is_one_line(
    change: Callable[[Any], Any], bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = tmp_path / "damaged.mmat"
    damaged.mkdir()
    for file in bundle.iterdir():
        (damaged / file.name).write_bytes(file.read_bytes())
    facts = json.loads((damaged / "material.json").read_text())
    change(facts)
    (damaged / "material.json").write_text(json.dumps(facts))
    assert main(["inspect", str(damaged)]) == 1
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and "damaged.mmat" in printed.err


# --- as a process -----------------------------------------------------------------------------------------


def test_output_is_json_and_nothing_else(tmp_path: Path) -> None:
    # Whatever prints on the way, through Python or past it, is no result.
    noise = "import os, ctypes\nprint('python')\nos.write(2, b'error stream')\nctypes.CDLL(None).puts(b'library')"
    code = (
        "import measured_materials.addon.cli.bake_brdf as bake\n"
        "def noisy(*a, of=bake.bake_source): " + noise.replace("\n", "; ") + "; return of(*a)\n"
        "bake.bake_source = noisy"
    )
    done = command("bake", "brdf", "--analytic", "lambert", "--json", *QUICK, before=code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["bundles"][0]["path"] == "lambert.mmat"
    assert "python" in done.stderr and "library" in done.stderr


def test_json_of_a_large_library_is_printed() -> None:
    """Of more than a bundle's document may hold."""
    stream = io.StringIO()
    assert _tell(Result({"materials": ["x" * 1000] * 5000}, []), True, stream) == 0
    assert len(json.loads(stream.getvalue())["materials"]) == 5000


BLOCK_BPY = "import sys; sys.modules['bpy'] = None"


def test_bake_and_inspect_need_no_blender(measurement: Path, tmp_path: Path) -> None:
    done = command("bake", "brdf", measurement, *QUICK, before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = command("inspect", "lacquer.mmat", before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 0 and "8 x 8 x 16" in done.stdout


@pytest.mark.parametrize("arguments", [["render"], ["demo"]])
def test_render_says_that_it_needs_blender(arguments: list[str], bundle: Path, tmp_path: Path) -> None:
    paths = [bundle] if arguments == ["render"] else []
    done = command(*arguments, *paths, before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "needs Blender" in done.stderr and not list(tmp_path.iterdir())


def test_render(bundle: Path, tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    size = ["--resolution", "24", "--samples", "2"]
    done = command("render", bundle, "--out", tmp_path / "a.png", "--exr", *size, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["files"] == [str(tmp_path / "a.png"), str(tmp_path / "a.exr")]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.exr", "a.png"]
    assert min(found["mean_linear"]) > 0.05
    done = command("render", bundle, "--out", tmp_path / "a.png", "--environment", tmp_path / "none.exr", *size)
    assert done.returncode == 1 and "none.exr" in done.stderr.splitlines()[-1]
    done = command("render", bundle, "--out", tmp_path / "a.jpg")
    assert done.returncode == 2


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_interruption_leaves_nothing(measurement: Path, tmp_path: Path) -> None:
    arguments = ["bake", "brdf", str(measurement), "--out", str(tmp_path / "out"), "--resolution", "128"]
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "measured_materials", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert "reading" in process.stderr.readline()
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read().splitlines()
        assert process.wait(60) == 130
        assert not process.stdout.read()
    assert "interrupted" in rest[-1] and "Traceback" not in "".join(rest)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_interruption_ends_what_does_not_come_back_to_python() -> None:
    # As a render does, the key derivation lets other threads run and looks at no signal until it is over.
    code = """
import hashlib, os, signal, tempfile, threading
from measured_materials.addon.cli.console import interrupts
interrupts._PATIENCE = 0.2
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
with interrupts.keyboard_interrupts():
    print(tempfile.mkdtemp(), flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 1 << 28)
"""
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 130
    assert not Path(done.stdout.strip()).exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such pipes")
def test_reader_of_the_output_may_leave(bundle: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "measured_materials", "inspect", str(bundle), "--json"],
            stdout=write,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    finally:
        os.close(write)
    assert done.returncode == 141 and not done.stderr

"""What `bake arc` and `inspect` refuse: wrong usage, and photographs that make no shading map. One line each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main, parser
from measured_materials.bake.images.image_io import write_image, write_png
from measured_materials.bake.images.storage import Storage
from support.stacks import complaints_in, frame, png_declaring, write_frame, write_stack


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_stack(tmp_path_factory.mktemp("stack") / "felt")


# --- wrong usage ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments, word",
    [
        ("bake arc", "nothing to bake"),
        ("bake arc x --slices 1", "--slices"),
        ("bake arc x --slices 65", "--slices"),
        ("bake arc x --rank 4", "--rank"),
        ("bake arc x --size -1", "size is -1"),
        ("bake arc x --decode jpeg", "decode is 'jpeg'"),
        ("bake arc x --spread nan", "spread is nan"),
        ("bake arc x --crop 1,2,3", "'1,2,3' is not 4 numbers"),
        ("bake arc x --crop 1,2,3,x", "is not 4 numbers"),
        ("bake arc x --crop 1,2,0,5", "width of crop is 0"),
        ("bake arc x --corners 1,1 2,2 3,3 4,4", "convex"),
        ("bake arc x --crop 0,0,9,9 --corners 1,1 9,1 9,9 1,9", "both a crop and corners"),
        ("bake arc x --albedo 0", "albedo is 0"),
        ("bake arc x --albedo 0.5 --white-card 0,0,2,2", "both a white card and an albedo"),
        ("bake arc x --through y --diffuser 0,0,-5,5", "width of diffuser is -5"),
        ("bake arc x --through y --transmittance 0.2 --diffuser 0,0,5,5", "both a diffuser and a transmittance"),
        ("bake arc x --diffuser-transmittance 0.4", "give --through FOLDER too"),
        ("bake arc x --through y --diffuser-transmittance 0.4", "give --diffuser X,Y,W,H too"),
        ("bake arc x --align maybe", "invalid choice"),
        ("bake arc x --sides left", "invalid choice"),
        ("bake arc x --storage jpeg", "invalid choice"),
        ("bake arc x --storage byte --compression power", "too coarse"),
        ("bake arc x --lobe velvet", "none of that name"),
        ("bake arc x --lobe ggx alpha=5", "alpha = 5"),
        ("bake arc x --lobe ggx gloss=1", "no parameter gloss"),
        ("bake arc x --lobe ggx alpha=wide", "KEY=VALUE"),
        ("bake arc --lobe ggx x", "paths go before"),
        ("bake arc x --lobe auto alpha=1", "takes no parameters"),
        ("bake arc x --sigma 0", "--sigma"),
        ("bake arc x --a-max -1", "--a-max"),
        ("bake arc x --plot x.jpg", "not a FILE.png"),
        ("bake arc x y --plot x.png", "one picture"),
        ("bake arc a b --out x.mmat", "names one bundle"),
        ("bake arc a/felt b/felt", "two inputs would become"),
    ],
)
def test_wrong_usage(
    arguments: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    printed = capsys.readouterr()
    assert word in printed.err and not printed.out and "Traceback" not in printed.err
    assert not list(tmp_path.iterdir())


def test_folders_and_files_are_not_mixed(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bake", "arc", str(stack), str(stack / "el15.png"), "--out", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bake", "arc", "--help"]) == 0
    text = capsys.readouterr().out
    for option in (
        "slices size decode lights azimuth spread crop corners flat-field white-card white-reflectance albedo align "
        "storage compression rank tileable lobe sigma above technique mode tiling a-max plot json out"
    ).split():
        assert f"--{option}" in text


# --- bad input --------------------------------------------------------------------------------------------


def one_photograph(folder: Path) -> None:
    write_stack(folder, (40,))


def two_sizes(folder: Path) -> None:
    write_stack(folder)
    write_frame(folder / "el80.png", frame(80, (22, 16)))


def equal_averages(folder: Path) -> None:
    write_stack(folder, ())
    for k in range(4):
        write_frame(folder / f"el{20 + k}.png", frame(50))


def clipped(folder: Path) -> None:
    write_stack(folder, ())
    for k in range(4):
        write_png(folder / f"el{20 + k}.png", np.full((16, 20, 3), 255, np.uint8))


def black(folder: Path) -> None:
    write_stack(folder, ())
    for k in range(4):
        write_png(folder / f"el{20 + k}.png", np.zeros((16, 20, 3), np.uint8))


def not_a_number(folder: Path) -> None:
    write_stack(folder, suffix=".exr")
    values = frame(40).astype(np.float32)
    write_image(folder / "el40.exr", values, Storage.FLOAT32)
    data = (folder / "el40.exr").read_bytes()
    values[3, 4, 1] = np.nan
    openexr = pytest.importorskip("OpenEXR")  # our own writer refuses them
    planes = {name: np.ascontiguousarray(values[..., k]) for k, name in enumerate("RGB")}
    openexr.File({"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}, planes).write(
        str(folder / "el40.exr")
    )
    assert (folder / "el40.exr").read_bytes() != data


def text_among_images(folder: Path) -> None:
    write_stack(folder)
    (folder / "el40.jpg").write_text("not a photograph\n")


def enormous_header(folder: Path) -> None:
    write_stack(folder)
    (folder / "el40.png").write_bytes(png_declaring(25000, 20000))


def cut_in_the_middle(folder: Path) -> None:
    write_stack(folder)
    data = (folder / "el55.png").read_bytes()
    (folder / "el55.png").write_bytes(data[: len(data) // 2])


def a_folder_in_the_middle(folder: Path) -> None:
    write_stack(folder)
    (folder / "el55.png").unlink()
    (folder / "lights.csv").write_text("file,elevation\nel15.png,15\nel35.png,35\nel55.png,fifty\n")


def empty(folder: Path) -> None:
    folder.mkdir()


def missing(folder: Path) -> None:
    pass


def bundle_already(folder: Path) -> None:
    write_stack(folder)
    (folder / "material.json").write_text("{}")


def unknown_names(folder: Path) -> None:
    write_stack(folder)
    (folder / "lights.lp").write_text("2\na.png 0 0 1\nb.png 0 1 1\n")


BAD: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "one photograph": (one_photograph, "felt", "one photograph only"),
    "two sizes": (two_sizes, "el80.png", "22 x 16"),
    "equal averages": (equal_averages, "felt", "same average"),
    "fully clipped": (clipped, "felt", "clipped"),
    "all black": (black, "felt", "black"),
    "NaN": (not_a_number, "el40.exr", "finite"),
    "text file among the images": (text_among_images, "el40.jpg", "not an image"),
    "500 megapixels": (enormous_header, "el40.png", "megapixels"),
    "unreadable in the middle": (cut_in_the_middle, "el55.png", "damaged"),
    "bad lights file": (a_folder_in_the_middle, "lights.csv", "fifty"),
    "lights of others": (unknown_names, "lights.lp", "none of the photographs"),
    "empty folder": (empty, "felt", "no photograph"),
    "missing folder": (missing, "felt", "does not exist"),
    "bundle": (bundle_already, "felt", "baked already"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_stack_is_one_line_and_leaves_nothing(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, name, word = BAD[case]
    make(tmp_path / "felt")
    assert main(["bake", "arc", str(tmp_path / "felt"), "--out", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr()
    (line,) = complaints_in(printed.err)
    assert name in line and word in line and "; " in line
    assert "Traceback" not in printed.err and not printed.out
    assert not (tmp_path / "out").exists()
    code = main(["inspect", str(tmp_path / "felt")])
    inspected = capsys.readouterr()
    # What cannot be baked may still be worth a look: equal averages are no fault of any photograph.
    assert code == 1 or case == "equal averages"
    assert len(complaints_in(inspected.err)) == code and "Traceback" not in inspected.err


def test_failed_bake_leaves_an_older_bundle_alone(tmp_path: Path) -> None:
    folder = write_stack(tmp_path / "felt")
    assert main(["bake", "arc", str(folder), "--out", str(tmp_path)]) == 0
    before = (tmp_path / "felt.mmat" / "material.json").read_bytes()
    (folder / "el40.png").write_bytes(b"")
    assert main(["bake", "arc", str(folder), "--out", str(tmp_path), "--slices", "4"]) == 1
    assert (tmp_path / "felt.mmat" / "material.json").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["felt", "felt.mmat"]


@pytest.mark.parametrize("text", ["", "file,elevation\n", "\0", "file,elevation\nel15.png,1e999\n"])
def test_bad_lights_option(text: str, stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "lamp.csv").write_text(text)
    arguments = ["--lights", str(tmp_path / "lamp.csv"), "--out", str(tmp_path / "out")]
    assert main(["bake", "arc", str(stack), *arguments]) == 1
    (line,) = complaints_in(capsys.readouterr().err)
    assert "lamp.csv" in line and not (tmp_path / "out").exists()


def test_older_scripts_say_arc() -> None:
    told = [parser().parse_args(["bake", word, "denim", "--slices", "5"]) for word in ("photographs", "arc")]
    assert vars(told[0]) == vars(told[1]) and told[0].command == "bake photographs"

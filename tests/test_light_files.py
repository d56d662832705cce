"""Light files as other programs and people write them: separators, decimal commas, units, encodings, spellings."""

from __future__ import annotations

import json
import math
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs.light_files.readers import read_lights
from measured_materials.bake.photographs.lights import find_lights
from support.photo_files import encode_srgb, write_photo

ELEVATIONS = (20, 45, 70)
# Cosine and sine of 20, 45 and 70 degrees, from a table.
DIRECTIONS = (("0.9397", "0.3420"), ("0.7071", "0.7071"), ("0.3420", "0.9397"))


def elevations_of(text: str | bytes, folder: Path, name: str) -> list[float]:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return [math.degrees(math.asin(entry.direction[2])) for entry in read_lights(path)[0]]


def listed(pattern: str) -> str:
    return "3\n" + "\n".join(pattern.format(k + 1, c, s) for k, (c, s) in enumerate(DIRECTIONS))


def stack(folder: Path, names: list[str]) -> Path:
    """Three even photographs, as bright as the sines of 20, 45 and 70 degrees."""
    folder.mkdir(exist_ok=True)
    for name, elevation in zip(names, ELEVATIONS):
        write_photo(folder / name, encode_srgb(np.full((6, 8, 3), 0.5 * math.sin(math.radians(elevation)))))
    return folder


def inspected(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    assert main(["inspect", str(folder), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    "pattern",
    [
        "p {0}.png {1} 0 {2}",
        "a, {0}.png {1} 0 {2}",
        "a, {0}.png, {1}, 0, {2}",
        "a {0}.png;{1};0;{2}",
        "'a {0}.png'\t{1}\t0\t{2}",
    ],
)
@pytest.mark.parametrize("comma", [False, True])
def test_lists_in_every_way_to_set_numbers_apart(tmp_path: Path, pattern: str, comma: bool) -> None:
    if comma and "{1}, 0" in pattern:
        return  # the comma cannot do both; refused below
    text = listed(pattern)
    if comma:
        for number in {number for pair in DIRECTIONS for number in pair}:
            text = text.replace(number, number.replace(".", ","))
    for name in ("l.lp", "lights.txt"):
        assert elevations_of(text, tmp_path, name) == pytest.approx(ELEVATIONS, abs=0.01)
    names = [Path(entry.file).name for entry in read_lights(tmp_path / "l.lp")[0]]
    assert names == [pattern.split(".png")[0].format(k).strip("'") + ".png" for k in (1, 2, 3)]


@pytest.mark.parametrize(
    ("name", "text", "cause"),
    [
        ("l.lp", "1\na.png,0,9397,0,0000,0,3420\n", "line 2: holds more numbers than three"),
        ("l.lp", "1\na.png 0.9397 0 0.3420 1.0\n", "line 2: holds more numbers than three"),
        ("l.lp", "a.png, 0,9, 0,0, 0,3\n", "line 1: holds more numbers than three"),
        ("lights.csv", "file,elevation,azimuth\na.png,20,9,0,0\n", "line 2: has 5 cells, the header has 3"),
        ("lights.csv", "file;elevation\na.png;20\nb.png;30;5\n", "line 3: has 3 cells, the header has 2"),
        ("lights.csv", "a.png,20,0,80\nb.png,45,0,81\nc.png,2,0,3\n", "no line of column names"),
        ("lights.csv", "file,theta,azimuth\na,0.35,90\nb,1.2,90.5\n", "look like radians, and azimuth in degrees"),
    ],
)
def test_numbers_that_could_mean_two_things_are_refused(tmp_path: Path, name: str, text: str, cause: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(BakeError, match=cause) as caught:
        read_lights(path)
    assert caught.value.remedy


def test_an_empty_cell_too_many_is_harmless(tmp_path: Path) -> None:
    text = "file,elevation\na.png,20,\nb.png,45,,\n"
    assert elevations_of(text, tmp_path, "lights.csv") == pytest.approx([20, 45])


def test_table_set_apart_by_blanks(tmp_path: Path) -> None:
    text = "file   elevation\na.png     20\n'b.png'  45.5\n"
    assert elevations_of(text, tmp_path, "lights.txt") == pytest.approx([20, 45.5])


@pytest.mark.parametrize(
    ("header", "radians", "told"),
    [
        ("file,theta,phi", [1.2217, 0.7854, 0.3491], True),
        ("file,elevation,azimuth", [0.3491, 0.7854, 1.2217], True),
        ("file,theta [rad],azimuth", [1.2217, 0.7854, 0.3491], False),
        ("file,elevation_rad,azimuth", [0.3491, 0.7854, 1.2217], False),
        ("file,elevation (radians),azimuth", [0.3491, 0.7854, 1.2217], False),
    ],
)
def test_radians_are_recognised(tmp_path: Path, header: str, radians: list[float], told: bool) -> None:
    path = tmp_path / "lights.csv"
    path.write_text(header + "\n" + "".join(f"{n}.png,{value},0\n" for n, value in zip("abc", radians)))
    entries, warnings = read_lights(path)
    found = [math.degrees(math.asin(entry.direction[2])) for entry in entries]
    assert found == pytest.approx(ELEVATIONS, abs=0.01)
    assert any("taken as radians (20 to 70 degrees)" in warning for warning in warnings) is told


@pytest.mark.parametrize("text", ["file,elevation\na,1\nb,2\n", "file,elevation [deg]\na,0.5\nb,1.5\n"])
def test_small_angles_in_degrees_stay(tmp_path: Path, text: str) -> None:
    assert max(elevations_of(text, tmp_path, "lights.csv")) < 2.01


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_umlauts_in_every_encoding_that_editors_save(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "lights.csv"
    path.write_bytes("file;elevation\nStoff Größe – 1.png;20\n".encode(encoding))
    assert read_lights(path)[0][0].file == "Stoff Größe – 1.png"


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_composed_and_decomposed_names_are_one(tmp_path: Path, form: str) -> None:
    other = "NFD" if form == "NFC" else "NFC"
    names = [unicodedata.normalize(form, f"Gr\xfcn \xc9t\xe9 {k}.png") for k in range(3)]
    text = "".join(f"{unicodedata.normalize(other, name)} {c} 0 {s}\n" for name, (c, s) in zip(names, DIRECTIONS))
    (tmp_path / "l.lp").write_text(text)
    lights = find_lights([tmp_path / name for name in names], None, True)
    assert lights.directions is not None and not lights.warnings
    assert lights.directions[:, 2] == pytest.approx(np.sin(np.radians(ELEVATIONS)), abs=1e-4)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Lights.csv", "file,elevation,azimuth\na.png,20,0\nb.png,45,0\nc.png,70,0\n"),
        ("LIGHTS.CSV", "file;elevation\na.png;20,0\nb.png;45,0\nc.png;70,0\n"),
        ("lights.txt", "a.png 0.9397 0 0.3420\nb.png 0.7071 0 0.7071\nc.png 0.3420 0 0.9397\n"),
        ("Dome.LP", "a.png 0,9397 0 0,3420\nb.png 0,7071 0 0,7071\nc.png 0,3420 0 0,9397\n"),
    ],
)
def test_inspect_finds_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str) -> None:
    folder = stack(tmp_path / "s", ["a.png", "b.png", "c.png"])
    (folder / name).write_text(text)
    found = inspected(folder, capsys)
    assert found["source"]["facts"]["lights"]["source"] == name
    assert found["averages"]["elevations_deg"] == pytest.approx(ELEVATIONS, abs=0.01)


def test_inspect_tells_of_a_list_under_another_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is read where it lists all photographs, and only told of where it does not."""
    folder = stack(tmp_path / "s", ["a.png", "b.png", "c.png"])
    lines = ["a.png 0.9397 0 0.3420", "b.png 0.7071 0 0.7071", "c.png 0.3420 0 0.9397"]
    (folder / "positions.txt").write_text("\n".join(lines))
    told = inspected(folder, capsys)["warnings"]
    assert any("the lights are those of positions.txt" in warning for warning in told)
    (folder / "positions.txt").write_text("\n".join(lines[:2]))
    told = inspected(folder, capsys)["warnings"]
    assert any("positions.txt lists lights, those of 2 of 3 photographs alone" in warning for warning in told)
    (folder / "positions.txt").write_text("\n".join(f"other/{line}" for line in lines))
    told = inspected(folder, capsys)["warnings"]
    assert any("positions.txt lists lights, with names of folders" in warning for warning in told)
    for name in ("positions.txt", "again.txt"):
        (folder / name).write_text("\n".join(lines))
    told = inspected(folder, capsys)["warnings"]
    assert any("again.txt, positions.txt list the lights" in warning and "lights.csv" in warning for warning in told)


@pytest.mark.parametrize("name", ["dome.lp", "dome.dat"])
def test_a_list_above_is_told_of_and_angles_in_names_come_first(tmp_path: Path, name: str) -> None:
    """It may be of other photographs of these names: image00.jpg is in any dome."""
    text = "\n".join(f"{k}.png 0 0 1\nel{10 * k}.png 0 0 1" for k in (1, 2, 3))
    (tmp_path / name).write_text(f"6\n{text}" if name.endswith(".lp") else text)
    lights = find_lights([tmp_path / "s" / f"{k}.png" for k in (1, 2, 3)], None, False)
    assert lights.directions is not None and lights.facts["source"] == name
    assert lights.warnings[0].startswith(f"the lights are those of {name} above this folder")
    lights = find_lights([tmp_path / "s" / f"el{10 * k}.png" for k in (1, 2, 3)], None, False)
    assert lights.directions is not None and lights.facts["source"] == "file names"
    assert lights.directions[:, 2] == pytest.approx(np.sin(np.radians([10, 20, 30])))

"""Where the light stood: light files, angles in names, the choice of an arc, exposures and brackets."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import Exposure, PhotoInfo, StackSettings, read_stack
from measured_materials.bake.photographs.brackets import bracket_stem, find_exposures, group_by_light, merge, trust
from measured_materials.bake.photographs.light_files.readers import direction_in_name, direction_of_angles, read_lights
from measured_materials.bake.photographs.lights import Lights, choose_arc, find_lights, light_files_beside
from measured_materials.bake.shading_maps.bake import ArcSettings, arc_recipe
from support.photo_files import encode_srgb, gray_frames, write_photo


def paths_of(folder: Path, *names: str) -> list[Path]:
    return [folder / name for name in names]


def angles(direction: np.ndarray) -> tuple[float, float]:
    """Elevation and azimuth, degrees."""
    x, y, z = direction
    return math.degrees(math.asin(z)), math.degrees(math.atan2(y, x))


def write_text(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


# --- files -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "2\na.jpg 0 0 2\nb c.jpg 3 0 4\n",
        "a.jpg 0 0 2\r\nb c.jpg 3 0 4\r\n",
        "# dome\n\n2\n jpg/a.jpg 0 0 2\n\\dome\\b c.jpg 3 0 4",
        "2\na.jpg, 0, 0, 2\n'b c.jpg', 3, 0, 4",
    ],
)
def test_lp(tmp_path: Path, text: str) -> None:
    entries, warnings = read_lights(write_text(tmp_path / "dirs.lp", text))
    assert [Path(entry.file).name for entry in entries] == ["a.jpg", "b c.jpg"] and not warnings
    assert entries[0].direction == (0, 0, 1)
    assert entries[1].direction == pytest.approx((0.6, 0, 0.8))


DILIGENT = {
    "light_directions.txt": "0 0 1\n0.6 0 0.8\n0 0.6 0.8\n",
    "light_intensities.txt": "1 1 1\n2 1 0.5\n0.5 0.5 0.5\n",
    "filenames.txt": "001.png\n002.png\n003.png\n",
}


def diligent(folder: Path, **changed: str) -> Path:
    """A folder as DiLiGenT's: one matte swatch under three lights of different strengths, its mask beside it."""
    for name, text in (DILIGENT | {f"{key}.txt": text for key, text in changed.items()}).items():
        if text:
            write_text(folder / name, text)
    cosines, strengths = (1.0, 0.8, 0.8), ((1, 1, 1), (2, 1, 0.5), (0.5, 0.5, 0.5))
    for k, (cosine, strength) in enumerate(zip(cosines, strengths, strict=True)):
        linear = np.broadcast_to(0.2 * cosine * np.array(strength), (4, 4, 3))
        write_photo(folder / f"{k + 1:03}.png", encode_srgb(linear))
    write_photo(folder / "mask.png", np.full((4, 4, 3), 255, np.uint8))
    return folder


def test_a_folder_of_diligent(tmp_path: Path) -> None:
    """Directions without names, the names beside them, and how strong each light was."""
    settings = StackSettings(spread=90, sides="both", align="off", decode="srgb")
    stack = read_stack(diligent(tmp_path), settings)
    assert stack.names == ("001.png", "002.png", "003.png") and stack.directions is not None
    np.testing.assert_allclose(stack.directions, [[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]])
    np.testing.assert_allclose(stack.images.mean((1, 2)), 0.2 * np.array([[1.0], [0.8], [0.8]]) * np.ones(3), rtol=0.02)
    assert stack.facts["strengths"] == "light_intensities.txt"
    card = replace(settings, white_card=(0, 0, 4, 4))
    # The card has seen the same light: all photographs are of one reflectance then.
    assert "strengths" not in read_stack(tmp_path, card).facts
    assert any("mask.png" in warning for warning in stack.warnings)


def test_what_is_read_with_directions_is_part_of_the_recipe(tmp_path: Path) -> None:
    """A library must not keep a bundle whose lights were corrected since."""
    folder = diligent(tmp_path)
    names = {path.name for path in light_files_beside(folder)}
    assert names == set(DILIGENT)
    origin = {"name": "swatch"}
    for settings in (ArcSettings(), ArcSettings(stack=StackSettings(lights=folder / "light_directions.txt"))):
        before = arc_recipe(folder, settings, origin)
        strengths = folder / "light_intensities.txt"
        strengths.write_text(strengths.read_text().replace("2 1 0.5", "2 1 0.25"))
        assert arc_recipe(folder, settings, origin) != before
        strengths.write_text(DILIGENT["light_intensities.txt"])


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({"filenames": ""}, "names no photographs"),
        ({"filenames": "001.png\n002.png\n"}, "lists 2 photographs, but light_directions.txt has 3"),
        ({"light_intensities": "1 1 1\n1 1 1\n"}, "does not hold three numbers above 0 for each of the 3"),
        *(
            ({"light_intensities": f"1 1 1\n1 {wrong} 1\n1 1 1\n"}, "does not hold three numbers above 0")
            for wrong in ("0", "-1", "nan", "inf", "1e999")
        ),
    ],
)
def test_half_a_folder_of_diligent(tmp_path: Path, changed: dict[str, str], cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        read_stack(diligent(tmp_path, **changed), StackSettings(spread=90, sides="both"))


@pytest.mark.parametrize(
    "text",
    [
        "file,elevation,azimuth\na.jpg,30,90\n",
        "Name;Azimuth [deg];Elevation [deg]\na.jpg;90,0;30,0\n",
        "azimuth_deg\timage\ttheta\n90\ta.jpg\t60\n",
        "\ufefffile,x,y,z\n# by hand\na.jpg,0,8.660254,5\n",
        'z,y,x,filename\n5,8.660254,0,"a.jpg"\n',
    ],
)
def test_table(tmp_path: Path, text: str) -> None:
    ((entry,), _) = read_lights(write_text(tmp_path / "lights.csv", text))
    assert entry.file == "a.jpg"
    assert entry.direction == pytest.approx((0, math.sqrt(0.75), 0.5), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "text", "cause"),
    [
        ("a.lp", "1\na.jpg 0 0 0\n", "line 2: the direction is zero"),
        ("a.lp", "a.jpg 0 nan 1\n", "line 1: the direction is not finite"),
        ("a.lp", "a.jpg 0 1\n", "line 1: is not 'file x y z'"),
        ("a.lp", "", "lists no light"),
        ("a.lp", "3\n", "lists no light"),
        ("a.lp", "a\0b", "is not text"),
        ("lights.csv", "a,30\n", "has no columns"),
        ("lights.csv", "file,azimuth\na,30\n", "has no columns"),
        ("lights.csv", "file,elevation\n", "lists no light"),
        ("lights.csv", "file,elevation\na.jpg,\n", "line 2: elevation is '', not a number"),
        ("lights.csv", "file,elevation\na.jpg,inf\n", "not a number"),
        ("lights.csv", "file,elevation\na.jpg,200\n", "an elevation of 200"),
        ("lights.csv", "file,elevation\n,20\n", "names no file"),
        ("lights.csv", 'file,elevation\n"a' + "b" * 200_000 + '",1\n', "field larger"),
    ],
)
def test_unusable_files_name_the_line(tmp_path: Path, name: str, text: str, cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        read_lights(write_text(tmp_path / name, text))


@given(st.binary(max_size=200), st.sampled_from(["a.lp", "lights.csv"]))
def test_any_bytes_give_entries_or_one_error(tmp_path_factory: pytest.TempPathFactory, data: bytes, name: str) -> None:
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(b"file,elevation\n" + data if name.endswith("csv") else data)
    try:
        for entry in read_lights(path)[0]:
            assert np.linalg.norm(entry.direction) == pytest.approx(1)
    except BakeError:
        pass


def test_announced_count_that_is_wrong_is_told(tmp_path: Path) -> None:
    _, (warning,) = read_lights(write_text(tmp_path / "dirs.lp", "3\na.jpg 0 0 1\n"))
    assert "announces 3 lights and lists 1" in warning


@pytest.mark.parametrize(
    ("stem", "expected"),
    [
        ("el45", (45, 0)),
        ("swatch_elev_45.5_az_90", (45.5, 90)),
        ("el22,5", (22.5, 0)),
        ("el30,az90", (30, 90)),
        ("IMG_0012_theta30", (60, 0)),
        ("theta-30", (60, 180)),  # the far side of an arc counted from the normal
        ("el-30", (30, 0)),
        ("Elevation 10 Azimuth-90", (10, -90)),
        ("model45", None),
        ("photo7", None),
        ("el400", None),
        ("gold_el120", (60, 180)),
        ("el30_phi120", (30, 120)),
    ],
)
def test_angles_in_names(stem: str, expected: tuple[float, float] | None) -> None:
    found = direction_in_name(stem)
    assert (found is None) == (expected is None)
    if expected and found:
        elevation, azimuth = angles(np.array(found))
        assert (elevation, azimuth % 360) == pytest.approx((expected[0], expected[1] % 360))


# --- matching --------------------------------------------------------------------------------------------


def test_prefixes_missing_doubled_and_unlisted(tmp_path: Path) -> None:
    text = "5\njpg/A.JPG 0 0 1\njpg/b.jpg 1 0 1\njpg/b.jpg 1 0 1\njpg/gone.jpg 1 0 2\njpg/low.jpg 1 0 -0.2\n"
    write_text(tmp_path / "dirs.lp", text)
    lights = find_lights(paths_of(tmp_path, "a.jpg", "b.jpg", "low.jpg", "normals.png"), None, True)
    assert lights.directions is not None
    assert [path.name for path in lights.paths] == ["a.jpg", "b.jpg"]
    told = " / ".join(lights.warnings)
    for part in ("lists twice: jpg/b.jpg", "not here: jpg/gone.jpg", "direction: normals.png", "horizon: low.jpg"):
        assert part in told
    assert lights.facts["left_out"] == ["normals.png", "low.jpg"]


def test_contradiction_and_foreign_files_are_errors(tmp_path: Path) -> None:
    file = write_text(tmp_path / "dirs.lp", "a.jpg 0 0 1\na.jpg 1 0 1\nb.jpg 1 0 1")
    with pytest.raises(BakeError, match=r"dirs\.lp: gives a\.jpg two different lights"):
        find_lights(paths_of(tmp_path, "a.jpg", "b.jpg"), None, True)
    with pytest.raises(BakeError, match="lists none of the photographs"):
        find_lights(paths_of(tmp_path, "c.jpg", "d.jpg"), file, True)
    below = write_text(tmp_path / "below.lp", "a.jpg 0 0 -1\nb.jpg 1 0 -1")
    with pytest.raises(BakeError, match="every light lies below the horizon"):
        find_lights(paths_of(tmp_path, "a.jpg", "b.jpg"), below, True)
    with pytest.raises(BakeError, match="several light files"):
        find_lights(paths_of(tmp_path, "a.jpg", "b.jpg"), None, True)


def test_equal_names_of_several_folders(tmp_path: Path) -> None:
    (tmp_path / "Dome").mkdir()
    text = "Test/a.jpg 1 0 1\nDome/a.jpg 0 0 1\nDome/b.jpg 0 1 1\nTest/b.jpg 0 -1 1"
    write_text(tmp_path / "dirs.lp", text)
    lights = find_lights(paths_of(tmp_path / "Dome", "a.jpg", "b.jpg"), None, False)  # found in the folder above
    assert lights.directions is not None
    assert lights.directions[0] == pytest.approx([0, 0, 1])
    assert lights.directions[1] == pytest.approx([0, 0.5**0.5, 0.5**0.5])


def test_table_goes_before_lp_and_names_come_last(tmp_path: Path) -> None:
    paths = paths_of(tmp_path, "el10.jpg", "el20.jpg", "ambient.jpg")
    assert find_lights(paths, None, True).facts["source"] == "file names"
    assert "left out, without a light direction: ambient.jpg" in find_lights(paths, None, True).warnings
    write_text(tmp_path / "d.lp", "el10.jpg 0 0 1\nel20.jpg 1 0 1")
    assert find_lights(paths, None, True).facts["source"] == "d.lp"
    write_text(tmp_path / "lights.csv", "file,elevation\nel10.jpg,40\nel20.jpg,50")
    assert find_lights(paths, None, True).facts["source"] == "lights.csv"
    nothing = find_lights(paths_of(tmp_path / "x", "a.jpg", "b.jpg"), None, True)
    assert nothing.directions is None and "no light directions" in nothing.warnings[0]


# --- arcs ------------------------------------------------------------------------------------------------


def lights_at(*places: tuple[float, float]) -> Lights:
    paths = [Path(f"{k}.jpg") for k in range(len(places))]
    return Lights(paths, np.array([direction_of_angles(*place) for place in places]))


def test_arc_with_most_elevations_is_chosen_and_told(tmp_path: Path) -> None:
    rich = [(10, 60), (30, 62), (50, 240), (70, 58), (85, 61)]
    poor = [(10, 150), (30, 330), (50, 151)]
    arc = choose_arc(tmp_path, lights_at(*rich, *poor), None, 15, "both")
    assert [path.name for path in arc.paths] == [f"{k}.jpg" for k in range(5)]
    assert arc.facts["arc"]["azimuth_deg"] == 60
    assert "5 of 8 used" in arc.warnings[0]
    arc = choose_arc(tmp_path, lights_at(*rich, *poor), None, 15)
    assert [path.name for path in arc.paths] == ["0.jpg", "1.jpg", "3.jpg", "4.jpg"]


def test_an_arc_stays_whole_without_a_warning(tmp_path: Path) -> None:
    lights = lights_at(*[(e, 45) for e in (5, 40, 80, 120, 175)])
    arc = choose_arc(tmp_path, lights, None, 20, "both")
    assert len(arc.paths) == 5 and not arc.warnings
    one = choose_arc(tmp_path, lights, None, 20)
    assert [path.name for path in one.paths] == ["0.jpg", "1.jpg", "2.jpg"] and "3 of 5 used" in one.warnings[0]
    assert not choose_arc(tmp_path, lights_at(*[(e, 45) for e in (5, 40, 80, 95)]), None, 20).warnings


def test_asked_azimuth(tmp_path: Path) -> None:
    lights = lights_at((10, 60), (30, 240), (50, 150), (89, 150))
    arc = choose_arc(tmp_path, lights, 60, 10, "both")
    assert [path.name for path in arc.paths] == ["0.jpg", "1.jpg", "3.jpg"]  # overhead lies in every plane
    with pytest.raises(BakeError, match="1 of 4 lights lie within 2 degrees of azimuth 5"):
        choose_arc(tmp_path, lights_at((10, 60), (30, 240), (50, 150), (10, 5)), 5, 2)
    with pytest.raises(BakeError, match="no light directions are known"):
        choose_arc(tmp_path, Lights([Path("a")], None), 60, 10)


@pytest.mark.parametrize("name", ["canvas", "painted_wood", "gold_icon", "tiny_relief/jpg"])
def test_genuine_light_files(shared_data: Path, name: str) -> None:
    folder = shared_data / "stacks" / name
    paths = sorted(folder.glob("*.jpg"))
    lights = find_lights(paths, None, True)
    assert lights.directions is not None and len(lights.paths) == len(paths) and not lights.warnings
    file = folder / "arcs.json" if (folder / "arcs.json").exists() else folder.parent / "arcs.json"
    by_name = {path.name: direction for path, direction in zip(lights.paths, lights.directions)}
    for arc in json.loads(file.read_text())["arcs"]:
        for image in arc["images"]:
            elevation, azimuth = angles(by_name[Path(image["file"]).name])
            assert elevation == pytest.approx(image["elevation_deg"], abs=0.06)  # the list is rounded to 0.1
            turn = (azimuth - image["azimuth_deg"] + 180) % 360 - 180
            assert abs(turn) < 0.06


# --- exposures and brackets ------------------------------------------------------------------------------


def infos_of(*exposures: tuple[float | None, float | None, float | None]) -> list[PhotoInfo]:
    return [PhotoInfo("jpeg", 8, 6, exposure=Exposure(*exposure)) for exposure in exposures]


def test_stems_of_brackets() -> None:
    stems = ["a_ev-2", "a_ev0", "a_ev+1.5", "a_b1", "a-bracket_2", "abs1", "develop3", "a"]
    assert [bracket_stem(stem) for stem in stems] == ["a", "a", "a", "a", "a", "abs1", "develop3", "a"]


def test_exposure_is_time_times_iso_over_f_number_squared(tmp_path: Path) -> None:
    paths = paths_of(tmp_path, "a.jpg", "b.jpg", "c.jpg")
    found = find_exposures(paths, infos_of((0.1, 4, 100), (0.05, 4, 100), (0.1, 8, 400)), [[0], [1], [2]])
    assert found.relative == pytest.approx([1, 0.5, 1])
    partly = infos_of((0.1, None, None), (None, 2, 100), (0.1, 2, 100))  # what is noted, is noted alike
    assert find_exposures(paths, partly, [[0], [1], [2]]).relative == [1, 1, 1]
    with pytest.raises(BakeError, match="only 2 of 3 photographs note their exposure"):
        find_exposures(paths, infos_of((0.1, 4, 100), (0.2, 4, 100), (None, 4, 100)), [[0], [1], [2]])
    with pytest.raises(BakeError, match="cannot be true"):
        find_exposures(paths, infos_of((1e-300, 4, 1), (1e300, 4, 1), (1, 4, 1)), [[0], [1], [2]])


def test_grouping_and_exposures_from_names(tmp_path: Path) -> None:
    paths = paths_of(tmp_path, "x_ev-2.jpg", "x_ev0.jpg", "y_ev-2.jpg", "y_ev+1.jpg")
    groups = group_by_light(paths, None)
    assert groups == [[0, 1], [2, 3]]
    nothing = infos_of(*[(None, None, None)] * 4)
    assert find_exposures(paths, nothing, groups).relative == pytest.approx([1, 4, 1, 8])
    alike = np.array([[0, 0, 1], [0, 0, 1], [0.6, 0, 0.8], [0, 0, 1.0]])
    assert group_by_light(paths, alike) == [[0, 1, 3], [2]]
    numbered = paths_of(tmp_path, "x_b1.jpg", "x_b2.jpg")
    with pytest.raises(BakeError, match=r"exposures of x_b1\.jpg, x_b2\.jpg are not known"):
        find_exposures(numbered, infos_of(*[(0.1, 4, 100)] * 2), [[0, 1]])


def test_merge_trusts_mid_tones_and_never_the_clipped() -> None:
    codes = np.array([[0.02], [0.5], [1.0]], np.float32)[..., None].repeat(3, -1)  # dark, middle, clipped
    weights = trust(codes, 1.0, 0.99)
    assert weights[2, 0] == 0 and weights[1, 0] > 4 * weights[0, 0] > 0
    both = merge([codes, codes * 7], [weights, np.zeros_like(weights)], [4.0, 1.0])
    assert np.allclose(both[:2], codes[:2]) and np.allclose(both[2], 7)  # the shortest where nothing is trusted


def test_bracketed_stack_exceeds_the_range_of_one_photograph(tmp_path: Path) -> None:
    scene = np.geomspace(0.004, 3.0, 64, dtype=np.float32).reshape(8, 8, 1).repeat(3, -1)
    for light, gain in (("el20", 0.5), ("el60", 1.0)):
        for ev in (-3, 0, 3):
            write_photo(tmp_path / f"{light}_ev{ev:+d}.png", encode_srgb(scene * gain * 2.0**ev))
    stack = read_stack(tmp_path, StackSettings(align="off"))
    assert stack.names[1] == "el60_ev-3.png + el60_ev+0.png + el60_ev+3.png"
    assert stack.facts["exposure"]["brackets"][0] == ["el20_ev-3.png", "el20_ev+0.png", "el20_ev+3.png"]
    # Relative to the first photograph, which has EV 0. 8 bits resolve mid-tones to about 1 %; 2 % where ramps overlap.
    assert np.allclose(stack.images[1], scene, rtol=0.02)
    assert stack.facts["clipped_share"] == [0, 0]
    assert any("factor of 64" in warning for warning in stack.warnings)


def test_exif_brackets_of_one_light_and_different_exposures_between_lights(tmp_path: Path) -> None:
    scene = np.linspace(0.02, 0.9, 48, dtype=np.float32).reshape(6, 8, 1).repeat(3, -1)
    shots = [("a", 20, 0.01), ("b", 20, 0.08), ("c", 50, 0.04), ("d", 50, 0.005)]
    for name, _, seconds in shots:
        codes = encode_srgb(scene * seconds / 0.02, np.uint16)
        write_photo(
            tmp_path / f"{name}.tif",
            codes,
            ExposureTime=seconds,
            FNumber=4.0,
            Exif__PhotographicSensitivity=100,
            Exif__ColorSpace=1,
        )
    write_text(tmp_path / "lights.csv", "file,elevation\n" + "".join(f"{n}.tif,{e}\n" for n, e, _ in shots))
    stack = read_stack(tmp_path, StackSettings(align="off"))
    assert stack.names == ("a.tif + b.tif", "d.tif + c.tif")
    # 16 bits; Exif holds the time as a fraction, good to a few parts in 1e4.
    assert np.allclose(stack.images, scene * 0.5, rtol=2e-3, atol=1e-5)


def test_repeats_are_averaged_only_where_they_agree(tmp_path: Path) -> None:
    for name, value in (("a_el20", 0.2), ("b_el20", 0.202), ("c_el60", 0.5)):
        write_photo(tmp_path / f"{name}.exr", gray_frames([value])[0])
    stack = read_stack(tmp_path)
    assert stack.images[0] == pytest.approx(0.201) and len(stack.names) == 2
    write_photo(tmp_path / "b_el20.exr", gray_frames([0.4])[0])
    with pytest.raises(BakeError, match=r"a_el20\.exr: is lit as b_el20\.exr and exposed alike, but is darker"):
        read_stack(tmp_path)

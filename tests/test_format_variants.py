"""Variants of formats: UTIA's pictures, ALTA's binary streams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array
from measured_materials.bake.sources import READERS, read_source
from support.format_files import BRUSHED, GLOSSY, error, pairs, write_utia
from support.format_variants import write_alta_stream, write_utia_picture


class _Leaning:
    """A measurement that is a little less than reciprocal, and tells the light from the viewer."""

    name, isotropic, bilateral = "leaning", False, False
    facts = {"format": "test"}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """Brighter where the light leans to +x, and towards +y of the viewer."""
        value = np.array(BRUSHED.evaluate(wi, wo))
        wi, wo = np.broadcast_arrays(wi, wo)
        return value * (1 + 0.2 * wi[..., :1] - 0.1 * wo[..., 1:2])


@pytest.mark.parametrize("flipped", [False, True])
def test_a_picture_of_utia_is_its_table(flipped: bool, tmp_path: Path) -> None:
    table = read_source(write_utia(tmp_path / "m.bin", _Leaning()))
    picture = read_source(write_utia_picture(tmp_path / "m.exr", _Leaning(), flipped))
    wi, wo = pairs(300)
    np.testing.assert_allclose(picture.evaluate(wi, wo), table.evaluate(wi, wo), rtol=1e-5, atol=1e-7)
    assert picture.facts["light_at_the_normal_in_row"] == ("last" if flipped else "first")
    errors = picture.facts["reciprocity_error_of_rows"]
    assert isinstance(errors, dict) and max(errors.values()) > 3 * min(errors.values())
    assert "values_read_as" in picture.facts and not picture.isotropic
    other = read_source(tmp_path / "m.exr", Reading(reciprocity="exchanged"))
    np.testing.assert_allclose(other.evaluate(wi, wo), table.evaluate(wo, wi), rtol=1e-5, atol=1e-7)


def test_other_pictures_are_no_measurements(tmp_path: Path) -> None:
    write_image(tmp_path / "photo.exr", np.zeros((288, 287, 3)), Storage.HALF)
    with pytest.raises(BakeError, match="is an OpenEXR picture"):
        read_source(tmp_path / "photo.exr")
    write_image(tmp_path / "mask.exr", np.zeros((288, 288, 1)), Storage.HALF)
    with pytest.raises(BakeError, match="is an OpenEXR picture"):
        read_source(tmp_path / "mask.exr")


@pytest.mark.parametrize("endian", ["little", "big"])
def test_a_binary_stream_of_alta_is_read(endian: str, tmp_path: Path) -> None:
    path = write_alta_stream(tmp_path / "sample.bin", GLOSSY, endian)
    assert [r.name for r in READERS if r.matches(path, path.read_bytes()[:64])] == ["ALTA"]
    source = read_source(path)
    assert source.facts["parameterisation"] == "SPHERICAL_TL_PL_TV_PV" and source.facts["quantity"] == "INV_STERADIAN"
    found = error(source, GLOSSY, True)
    assert found < 0.06, found


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"ieee754-double", b"ieee754-single", "not ieee754-double"),
        (b"#ENDIAN little", b"#ENDIAN middle", "not little or big"),
        (b"#SAMPLE_COUNT 9", b"#SAMPLE_COUNT 99999999999", "not a number from 1 to"),
        (b"#SAMPLE_COUNT 9", b"#SAMPLE_COUNT 19", "is truncated"),
        (b"#SAMPLE_COUNT 9", b"#SAMPLE_COUNT x", "not a number from 1 to"),
        (b"#END_STREAM", b"more behind", "does not end behind"),
        (b"#BEGIN_STREAM\n", b"#BEGIN_STREAM and\n", "more than #BEGIN_STREAM"),
        (b"#DIM 4 1", b"#DIM 3 1", "SPHERICAL_TL_PL_TV_PV has 4 numbers"),
        (b"INV_STERADIAN", b"SOMETHING_NEW", "#PARAM_OUT is 'SOMETHING_NEW'"),
    ],
)
def test_damaged_streams_are_refused_with_their_reason(old: bytes, new: bytes, says: str, tmp_path: Path) -> None:
    path = write_alta_stream(tmp_path / "sample.alta", GLOSSY)
    data = path.read_bytes()
    assert data.count(old) == 1
    path.write_bytes(data.replace(old, new))
    with pytest.raises(BakeError, match=says):
        read_source(path)
    path.write_bytes(data.replace(b"#BEGIN_STREAM", b"#BEGIN_STREAN"))
    with pytest.raises(BakeError):
        read_source(path)

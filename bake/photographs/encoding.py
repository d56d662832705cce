"""What the numbers of a photograph's file mean: one transfer function and one set of primaries, with their origin.

8 and 16-bit files follow a transfer function. Which one is a convention, not a measurement: a camera's JPEG adds a
tone curve of its own that no maker publishes, so decoding it as sRGB is an assumption, and is reported as one. What
the file says of its colours is exact, and is followed in the order that the PNG specification (third edition) gives:
code points, profile, "sRGB", chromaticities and gamma; then Exif.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from .photograph import FLOAT_FORMATS, PhotoInfo
from .radiometry.color_marks import Chromaticities, ColorMarks
from .radiometry.icc_profile import IccProfile, parse_icc
from .radiometry.primaries import KNOWN, REC709, matrix_to_xyz, name_of, to_rec709
from .radiometry.response import DIFFUSE_WHITE, LINEAR, SRGB, Response, parse_rule

# Code points of ITU-T H.273, tables 2 and 3.
_CODED_PRIMARIES = {
    1: "Rec.709", 4: "BT.470 M", 5: "BT.601 625 lines", 6: "BT.601 525 lines", 7: "BT.601 525 lines",
    8: "film, illuminant C", 9: "BT.2020", 11: "DCI-P3", 12: "Display P3", 22: "EBU Tech. 3213",
}  # fmt: skip
_CODED_XYZ = 10
_CODED_CURVES = {
    1: Response("bt709"), 4: Response("gamma:2.2", 2.2), 5: Response("gamma:2.8", 2.8), 6: Response("bt709"),
    8: LINEAR, 13: SRGB, 14: Response("bt709"), 15: Response("bt709"), 16: Response("pq"), 18: Response("hlg"),
}  # fmt: skip
_UNSPECIFIED = 2
_INTEROP = {
    "ap0": "ACES2065-1 (AP0)", "ap1": "ACEScg (AP1)", "rec709": "Rec.709", "p3d65": "Display P3",
    "rec2020": "BT.2020", "adobergb": "Adobe RGB (1998)",
}  # fmt: skip
_ADOBE = "Adobe RGB (1998)"
_ADOBE_GAMMA = Response("gamma:2.19922", 563 / 256)  # Adobe RGB (1998) Color Image Encoding, 4.3.1.2
_PLAIN_REMEDY = "export it as sRGB, or with a profile of primaries and curves"
Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Encoding:
    """Encoding of a photograph: how it is decoded.

    curves : one transfer function, or one per channel
    why : where they come from, in words
    matrix : (3, 3) from linear values to linear Rec.709, None where they are that already
    space : name of the primaries that `matrix` leaves, "" without one
    warnings : single lines; {} stands for the names of the photographs
    """

    curves: tuple[Response, ...]
    why: str
    matrix: Matrix | None = None
    space: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the transfer function, as `Response.name`."""
        return " ".join(dict.fromkeys(curve.name for curve in self.curves))

    def linear(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Linear light of encoded values (..., 1 or 3), before the matrix."""
        if len(self.curves) == 1 or values.shape[-1] == 1:
            return self.curves[0].linear(values)
        return np.stack([curve.linear(values[..., k]) for k, curve in enumerate(self.curves)], axis=-1)

    def tables(self, dtype: np.dtype[Any]) -> list[NDArray[np.float32]]:
        """Linear light of every code of uint8 or uint16, one table or one per channel."""
        return [curve.table(dtype) for curve in self.curves]


def choose_encoding(path: Path, info: PhotoInfo, rule: str) -> Encoding:
    """Encoding of one photograph; a rule of the user's replaces the transfer function, not the primaries.

    Raises BakeError where the file names an encoding that is not known here.
    """
    asked = parse_rule(rule)
    if info.format in FLOAT_FORMATS:
        return _of_floats(info)
    found = _of_codes(path, info, asked)
    if info.is_float:
        return replace(found, curves=(LINEAR,), why="floating-point values are linear")
    if asked is not None:
        return replace(found, curves=(asked,), why="as the user said")
    return found


def _of_floats(info: PhotoInfo) -> Encoding:
    marks, linear = info.color, Encoding((LINEAR,), f"{info.format} holds linear values")
    if marks.xyz or (marks.chromaticities and marks.chromaticities[:6] == (1, 0, 0, 1, 0, 0)):
        return replace(linear, matrix=to_rec709(np.eye(3), adapt=False), space="CIE XYZ")
    if marks.chromaticities:
        return _with_primaries(linear, marks.chromaticities)
    if marks.color_interop_id:
        return _of_interop_id(linear, marks.color_interop_id)
    return linear


def _of_interop_id(linear: Encoding, identity: str) -> Encoding:
    """`colorInteropID` of the Color Interop Forum, for example lin_ap1_scene; "data" and "unknown" say nothing."""
    curve, _, rest = identity.strip().lower().partition("_")
    name = rest.partition("_")[0]
    if curve == "lin" and name in _INTEROP:
        return _with_primaries(linear, KNOWN[_INTEROP[name]])
    if curve == "lin" and name == "ciexyzd65":
        return replace(linear, matrix=to_rec709(np.eye(3), adapt=False), space="CIE XYZ")
    if identity in ("data", "unknown"):
        return linear
    warning = f"colour space {identity[:40]!r} of {{}} is not known: taken as linear Rec.709"
    return replace(linear, warnings=(warning,))


def _of_codes(path: Path, info: PhotoInfo, asked: Response | None) -> Encoding:
    marks = info.color
    if marks.cicp is not None:
        return _of_code_points(path, marks.cicp, f"the {info.format}'s code points (cICP)", asked)
    if marks.icc:
        return _of_profile(path, parse_icc(marks.icc))
    if marks.srgb:
        return Encoding((SRGB,), "sRGB by the metadata of the file")
    if marks.gamma is not None or marks.chromaticities is not None:
        return _of_numbers(marks)
    return _of_exif(info)


def _of_code_points(
    path: Path, codes: tuple[int, int, int, int], origin: str, asked: Response | None = None
) -> Encoding:
    primaries, transfer, _, full = codes
    curve = asked or (SRGB if transfer == _UNSPECIFIED else _CODED_CURVES.get(transfer))
    known = primaries in _CODED_PRIMARIES or primaries in (_UNSPECIFIED, _CODED_XYZ)
    if curve is None or not known or not full:
        what = f"primaries {primaries}, transfer {transfer}" + ("" if full else " in narrow range")
        remedy = "export it as sRGB" + ", or say by decode what its curve is" * (curve is None and known and bool(full))
        raise BakeError(path, f"states an encoding that is not known here (H.273: {what})", remedy)
    scale = {"pq": f", {DIFFUSE_WHITE:g} cd/m² as 1", "hlg": ", light of the scene"}.get(curve.name, "")
    found = Encoding((curve,), origin + scale)
    if primaries == _CODED_XYZ:
        return replace(found, matrix=to_rec709(np.eye(3), adapt=False), space="CIE XYZ")
    return found if primaries == _UNSPECIFIED else _with_primaries(found, KNOWN[_CODED_PRIMARIES[primaries]])


def _of_profile(path: Path, profile: IccProfile | None) -> Encoding:
    plain = Encoding((SRGB,), "assumed: the file's profile cannot be applied")
    if profile is None:
        return replace(plain, warnings=(f"the colour profile of {{}} is damaged: taken as sRGB; {_PLAIN_REMEDY}",))
    if profile.cicp is not None and profile.cicp[1] in (16, 18):
        return _of_code_points(path, (*profile.cicp[:3], 1), f"the colour profile {profile.name}")
    if not profile.curves:
        kind = "works by tables" if profile.color_space == "RGB" else f"is for {profile.color_space}, not RGB"
        warning = f"colour profile {profile.name} of {{}} {kind} and was not applied: taken as sRGB; {_PLAIN_REMEDY}"
        return replace(plain, warnings=(warning,))
    found = Encoding(profile.curves, f"the colour profile {profile.name}")
    matrix = None if profile.colorants is None else to_rec709(profile.colorants)
    return found if matrix is None else replace(found, matrix=matrix, space=profile.name)


def _of_numbers(marks: ColorMarks) -> Encoding:
    """gAMA and cHRM of a PNG, tags of a TIFF."""
    found = Encoding((SRGB,), "assumed: the file states primaries alone")
    if marks.gamma is not None:
        if abs(marks.gamma - 1) < 0.01:
            found = Encoding((LINEAR,), "the file's metadata says linear")
        elif 1 < marks.gamma < 4:
            gamma = round(marks.gamma, 3)
            found = Encoding((Response(f"gamma:{gamma:g}", gamma),), f"the file's metadata says gamma {gamma:g}")
        else:
            found = Encoding((SRGB,), "assumed: the file's gamma cannot be true")
    return found if marks.chromaticities is None else _with_primaries(found, marks.chromaticities)


def _of_exif(info: PhotoInfo) -> Encoding:
    marks = info.color
    if marks.exif_color_space in (2, 65535) and marks.interoperability != "R98":
        found = _with_primaries(Encoding((_ADOBE_GAMMA,), "Exif says Adobe RGB"), KNOWN[_ADOBE])
        if marks.exif_color_space == 2 or marks.interoperability == "R03":
            return found
        warning = (
            "Exif of {} says that colours are not sRGB, not what they are: taken as Adobe RGB, which cameras mark so"
        )
        return replace(found, why="Exif says that it is not sRGB: taken as Adobe RGB", warnings=(warning,))
    if marks.exif_color_space == 1 or info.format in ("jpeg", "png"):
        return Encoding((SRGB,), f"sRGB by the metadata of the file or the convention of {info.format}")
    return Encoding((SRGB,), "assumed: nothing in the file says otherwise")


def _with_primaries(encoding: Encoding, space: Chromaticities) -> Encoding:
    matrix = None if space == REC709 else to_rec709(matrix_to_xyz(space))
    return encoding if matrix is None else replace(encoding, matrix=matrix, space=name_of(space))

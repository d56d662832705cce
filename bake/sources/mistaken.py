"""Files that people take for measurements, by their first bytes: what they are, and what to do instead."""

from __future__ import annotations

from pathlib import Path

from ..errors import BakeError

_DOWNLOAD = "download the file itself, not the page about it"
_LFS = "fetch the file itself with git lfs pull"
_UNPACK = "unpack it and give the measurement inside"
_PICTURE = "a picture is no BRDF; photographs of a swatch are baked by: bake arc FOLDER"

# First bytes in lower case, after blanks; what such a file is; what helps.
_KINDS: tuple[tuple[bytes, str, str], ...] = (
    (b"<!doctype html", "is a web page", _DOWNLOAD),
    (b"<html", "is a web page", _DOWNLOAD),
    (b"version https://git-lfs", "is a pointer of Git LFS, not the file", _LFS),
    (b"/annex/objects", "is a pointer of git-annex, not the file", "fetch the file itself with git annex get"),
    (b"pk\x03\x04", "is a zip archive", _UNPACK),
    (b"\x1f\x8b", "is a gzip archive", _UNPACK),
    (b"rar!", "is a RAR archive", _UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "is a 7-Zip archive", _UNPACK),
    (b"%pdf", "is a PDF document", _DOWNLOAD),
    (b"\x89png", "is a PNG picture", _PICTURE),
    (b"\xff\xd8\xff", "is a JPEG picture", _PICTURE),
    (b"v/1\x01", "is an OpenEXR picture", _PICTURE),
    (b"scatfun\x01", "is a Fourier BSDF of pbrt", "give the measurement that it was made from"),
    (b"optis - ", "is a Speos file", "export the measurement as ASTM, Zemax or a table"),
)


def refuse_mistaken(path: Path, head: bytes) -> None:
    """Raise BakeError where the first bytes are those of something else."""
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    for first, what, remedy in _KINDS:
        if start.startswith(first.lower()) or head.lower().startswith(first):
            raise BakeError(path, what, remedy)

"""Readers of measured BRDF files and analytic BRDFs, all behind `read_source`."""

from __future__ import annotations

from pathlib import Path

from ..errors import BakeError
from ..reading import Reading
from ..source import BrdfSource, Reader
from . import cornell, mbsdf, merl, neural_brdf, npy_table, rgl, utia
from .exchanged import exchanged_source
from .goniometer import alta, astm, fred, integra, lighttools, pab_opto, table, zemax
from .lookup.text_file import file_name_of
from .mistaken import refuse_mistaken
from .published import parameters
from .radiance import window_xml

READERS: tuple[Reader, ...] = (
    merl.READER,
    rgl.READER,
    cornell.READER,
    utia.READER,
    mbsdf.READER,
    zemax.READER,
    lighttools.READER,
    fred.READER,
    astm.READER,
    alta.READER,
    pab_opto.READER,
    integra.READER,
    window_xml.READER,
    neural_brdf.READER,
    npy_table.READER,
    parameters.READER,
    table.READER,
)


def known_formats() -> str:
    """The formats that can be read, as one phrase for messages and file dialogues."""
    return ", ".join(f"{reader.name} ({' '.join(reader.suffixes)})" for reader in READERS)


def known_suffixes() -> tuple[str, ...]:
    """The suffixes that measurements have, each once."""
    return tuple(dict.fromkeys(suffix for reader in READERS for suffix in reader.suffixes))


def read_source(path: str | Path, reading: Reading | None = None) -> BrdfSource:
    """Read a measured BRDF in any known format.

    Content decides before the suffix, so that a renamed file is still read; a file whose content nobody
    recognises goes to the reader of its suffix, which can say exactly what is wrong with it.

    Raises
    ------
    BakeError : the path is no readable, non-empty file, its format is unknown, or its reader refuses it
    """
    path, reading = Path(path), reading or Reading()
    source = _reader_of(path).read(path, reading)
    return source if reading.reciprocity == "measured" else exchanged_source(source, reading.reciprocity)


def chosen_material(path: str | Path, reading: Reading) -> str:
    """Name of the one of a file's materials that `reading.material` means, spelt as the file has it.

    "" where nothing was chosen, and of a file of one material, whose name the choice does not change. Raises BakeError
    as `read_source`, but for what is wrong with the values.
    """
    if not reading.material:
        return ""
    reader = _reader_of(Path(path))
    return reader.chosen(Path(path), reading) if reader.chosen else ""


def materials_in(path: str | Path, reading: Reading) -> list[str]:
    """Names of the materials in a file of several, or of the one among them that is chosen; none of a file of one.

    Raises BakeError as `chosen_material`.
    """
    if reading.material:
        return [name] if (name := chosen_material(path, reading)) else []
    reader = _reader_of(Path(path))
    return reader.listed(Path(path)) if reader.listed else []


def title_of(path: str | Path, reading: Reading) -> str:
    """What a material that is read from a file is called: as the one chosen in it, else as the file; never a path.

    Of a file that cannot be read, which its reader tells, the file's name.
    """
    try:
        return file_name_of(chosen_material(path, reading)) or Path(path).stem
    except BakeError:
        return Path(path).stem


def _reader_of(path: Path) -> Reader:
    """The reader of a file. Raises BakeError."""
    remedy = f"give a file in one of the known formats: {known_formats()}"
    head = _first_bytes(path, remedy)
    by_suffix = [reader for reader in READERS if path.suffix.lower() in reader.suffixes]
    by_content = [reader for reader in READERS if reader.matches(path, head)]
    both = [reader for reader in by_content if reader in by_suffix]
    if not by_content:
        refuse_mistaken(path, head)
    for reader in (*both, *by_content, *by_suffix):
        return reader
    raise BakeError(path, f"neither the suffix '{path.suffix}' nor the content is of a known format", remedy)


# Suffixes that many programs use: such a file in a folder is a measurement only by its content.
_OF_ANY_PROGRAM = frozenset({".bin", ".csv", ".dat", ".h5", ".json", ".npy", ".txt", ".xml"})


def measurements_in(folder: Path) -> list[Path]:
    """Files in a folder, not below it, that a reader knows by their content or by a suffix that nothing else has.

    Raises BakeError where there is none, or the folder cannot be read.
    """
    remedy = f"choose a folder with files in the known formats: {known_formats()}"
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise BakeError(folder, f"cannot be read ({cause})", remedy) from error
    found = [path for path in files if is_measurement(path)]
    if not found:
        raise BakeError(folder, "holds no measurement", remedy)
    return found


def is_measurement(path: Path) -> bool:
    """Whether a reader knows a file by its content, or by a suffix that nothing else has."""
    suffix = path.suffix.lower()
    if suffix in known_suffixes() and suffix not in _OF_ANY_PROGRAM:
        return True
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
    except OSError:
        return False
    return bool(head) and any(reader.matches(path, head) for reader in READERS)


def _first_bytes(path: Path, remedy: str) -> bytes:
    try:
        if path.is_dir():
            raise BakeError(path, "is a folder, not a file", remedy)
        if not path.exists():
            raise BakeError(path, "does not exist", remedy)
        if not path.is_file():
            raise BakeError(path, "is not a plain file", remedy)
        with path.open("rb") as stream:
            head = stream.read(64)
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise BakeError(path, f"cannot be opened ({cause})", remedy) from error
    if not head:
        raise BakeError(path, "is empty", remedy)
    return head

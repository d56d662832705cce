"""What there is to bake: measurements by content, folders of photographs and formulas, in folders and in lists."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import SUFFIX, is_bundle
from ...bake.errors import BakeError
from ...bake.photographs.photograph import IMAGE_SUFFIXES
from ...bake.reading import Reading
from ...bake.sources import is_measurement, materials_in
from ...bake.sources.lookup.text_file import file_name_of
from ..baking.request import Model
from .names import Wanted

LIST_SUFFIX = ".list"
# One picture in a folder is a preview or a scan: a stack has a photograph for each of several lights.
_FEWEST_PHOTOGRAPHS = 3
_MOST_LIST_BYTES = 64 << 20


@dataclass(frozen=True)
class Source:
    """One material's source.

    Parameters
    ----------
    source : a measurement's file, a folder of photographs, or a formula
    words : that name it on the command line, paths absolute
    photographs : whether it is a folder of photographs
    material : the one that is meant among several in the file
    refused : why there is nothing to bake; None where there is
    """

    source: Path | Model
    words: tuple[str, ...]
    photographs: bool = False
    material: str = ""
    refused: BakeError | None = None

    def wanted(self, given: str = "", apart: bool = False) -> Wanted:
        """What its bundle would be called; `apart`: the name that is given tells it from others of the same source."""
        said = json.dumps([*self.words, self.material, given if apart else ""])
        identity = hashlib.sha256(said.encode("utf-8", "surrogatepass")).hexdigest()[:32]
        if isinstance(self.source, Model):
            pairs = [_pair(key, value) for key, value in self.source.parameters.items()]
            stem = self.source.name.lower().replace("_", "-")
            return Wanted(stem, "-".join([stem, *pairs]), identity, given, self.source.name)
        stem = self.source.name if self.photographs or self.refused else self.source.stem
        stem = file_name_of(self.material) or stem
        return Wanted(stem, f"{self.source.parent.name}-{stem}", identity, given, str(self.source))


def _pair(key: str, value: Any) -> str:
    numbers = value if isinstance(value, tuple | list) else (value,)
    return "-".join([key, *(f"{one:g}" if isinstance(one, float) else str(one) for one in numbers)])


def wanted_of(given: Sequence[tuple[Source, str]], earlier: Collection[str]) -> list[Wanted]:
    """What the bundles of sources, each with the name given to it or "", would be called.

    A source is the same under whatever name, also alone in a farm's task, but where it comes twice with different
    settings, or did in the library's last table, of whose identities `earlier` consists.
    """
    count = Counter(source.wanted().identity for source, _ in given)
    found = []
    for source, name in given:
        apart = source.wanted(name, apart=True)
        twice = count[source.wanted().identity] > 1 or apart.identity in earlier
        found.append(apart if twice else source.wanted(name))
    return found


def sources_in(path: Path, reading: Reading, out: Path) -> list[Source]:
    """The sources that a path stands for: a file, or what lies in a folder and below it; `out` is left out.

    A file that does not exist, or that nothing reads, is a source too: its bake says what is wrong with it. So is a
    folder that cannot be read, and one in which there is nothing to bake: it is refused.
    """
    path = Path(os.path.abspath(path))
    if not _is_folder(path):
        return _of_file(path, reading)
    unread: list[OSError] = []
    found = [source for folder in _folders(path, out, unread) for source in _of_folder(folder, reading)]
    found += [_unreadable(Path(error.filename or path), error) for error in unread]
    if not found:
        remedy = "give a folder with measurements, or with photographs of a swatch under at least three lights"
        return [_refused(path, BakeError(path, "holds nothing to bake", remedy))]
    return found


def _refused(folder: Path, error: BakeError) -> Source:
    return Source(folder, (str(folder),), refused=error)


def _unreadable(folder: Path, error: OSError) -> Source:
    return _refused(folder, BakeError(folder, f"cannot be read ({error.strerror})", "check its permissions"))


def formula(name: str, parameters: dict[str, Any], words: Sequence[str]) -> Source:
    """A formula as a source; `words` are its name and KEY=VALUE as they were given."""
    return Source(Model(name, parameters), ("--analytic", *words))


def lines_of(file: Path) -> list[tuple[int, list[str]]]:
    """Words of each line of a list, with its number: blank lines and what follows # are left out. Raises BakeError."""
    try:
        if file.stat().st_size > _MOST_LIST_BYTES:
            raise BakeError(file, f"is larger than {_MOST_LIST_BYTES >> 20} MiB", "give several lists")
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        cause = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise BakeError(file, cause, "give a text file in UTF-8 with one source on each line") from error
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        try:
            words = _words(line)
        except ValueError as error:
            raise BakeError(file, f"line {number} has an open quotation mark", "close it") from error
        if words:
            found.append((number, words))
    return found


def _words(line: str) -> list[str]:
    reader = shlex.shlex(line, posix=True, punctuation_chars="")
    reader.whitespace_split = True
    reader.escape = ""  # of Windows' paths
    return list(reader)


def _of_file(path: Path, reading: Reading) -> list[Source]:
    try:
        materials = materials_in(path, reading)
    except (BakeError, OSError, ValueError):
        materials = []
    if not materials:
        return [Source(path, (str(path),))]
    return [Source(path, (str(path),), material=name) for name in materials]


def _of_folder(folder: Path, reading: Reading) -> list[Source]:
    """Measurements in a folder, or else its photographs."""
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    except OSError as error:
        return [_unreadable(folder, error)]
    measured = [source for path in files if is_measurement(path) for source in _of_file(path, reading)]
    if measured:
        return measured
    photographs = [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES]
    return [Source(folder, (str(folder),), photographs=True)] if len(photographs) >= _FEWEST_PHOTOGRAPHS else []


def _folders(top: Path, out: Path, unread: list[OSError]) -> Iterator[Path]:
    """A folder and those below it, without bundles, hidden ones and the library itself; errors of those that cannot be
    listed go to `unread`."""
    for place, names, _ in os.walk(top, onerror=unread.append):
        folder = Path(place)
        yield folder
        names[:] = sorted(name for name in names if not name.startswith(".") and not _is_ours(folder / name, out))


def _is_ours(folder: Path, out: Path) -> bool:
    return folder.suffix.lower() == SUFFIX or is_bundle(folder) or folder == out


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False

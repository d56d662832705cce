"""What an asset library was written from: one JSON file in its folder, by which only what has changed is done again."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ...bake.atomic_write import replacing_file
from ...bake.bundle.bundle import MATERIAL, PREVIEW
from ...bake.bundle.checked_json import dump_json, load_json
from ...bake.errors import BakeError
from .blend_file import AssetSettings

FILE = "measured_assets.json"
# Changes where the same bundle is to become another .blend than before.
_VERSION = 1
# Of the file: a million assets.
_MOST_BYTES = 256 << 20


@dataclass
class Written:
    """Of each .blend of a library, by its path there: what it was written from, and its own content, as SHA-256.

    While one is replaced it is said to be written from "", and has two contents: the older file's, and the new one's.
    """

    folder: Path
    entries: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @staticmethod
    def read(folder: Path) -> Written:
        """What is noted in this folder; nothing where that is not to be read, or was written by another version."""
        try:
            document = load_json(folder / FILE, _MOST_BYTES)
        except (BakeError, ValueError):
            return Written(folder)
        listed = document.get("assets")
        if document.get("version") != _VERSION or not isinstance(listed, dict):
            return Written(folder)
        pairs = {name: tuple(pair) for name, pair in listed.items() if isinstance(pair, list)}
        whole = {name: pair for name, pair in pairs.items() if len(pair) > 1 and all(map(_is_text, pair))}
        return Written(folder, whole)

    def announce(self, name: str, new: Path) -> None:
        """The file `new` is about to take a .blend's place: ours it is either way. Raises OSError, BakeError."""
        self._enter(name, "", *self.entries.get(name, ())[1:], content_of(new))

    def note(self, name: str, origin: str) -> None:
        """A .blend has just been written from what `origin` says. Raises OSError, BakeError."""
        self._enter(name, origin, content_of(self.folder / name))

    def _enter(self, name: str, *entry: str) -> None:
        self.entries[name] = entry
        text = dump_json({"version": _VERSION, "assets": self.entries}, self.folder / FILE, _MOST_BYTES)
        with replacing_file(self.folder / FILE) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")

    def is_current(self, name: str, origin: str) -> bool:
        """Whether there is a .blend written from just this; a person may have saved it since."""
        return self.entries.get(name, ("",))[0] == origin and (self.folder / name).is_file()

    def is_ours(self, name: str) -> bool:
        """Whether there is nothing to lose: no file, or one that nobody else has written or saved. Raises OSError."""
        file = self.folder / name
        if not file.exists() and not file.is_symlink():
            return True
        return file.is_file() and not file.is_symlink() and content_of(file) in self.entries.get(name, ())[1:]


def origin_of(bundle: Path, settings: AssetSettings) -> str:
    """SHA-256 of all that an asset is made of: the bundle, whose document states that of its images, and the settings.

    Raises OSError.
    """
    digest = hashlib.sha256(repr((_VERSION, sorted(asdict(settings).items()))).encode())
    digest.update(content_of(bundle / MATERIAL).encode())
    if settings.preview == "bundle" and (bundle / PREVIEW).is_file():
        digest.update(content_of(bundle / PREVIEW).encode())
    return digest.hexdigest()


def content_of(file: Path) -> str:
    """SHA-256 of a file. Raises OSError."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _is_text(value: object) -> bool:
    return isinstance(value, str)

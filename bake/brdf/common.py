"""What the records of both kinds of bundle share: source, images, albedo, and how a material was built."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

from ..bundle.bundle import MATERIAL, Bundle, Kind
from ..bundle.checked_json import Fields, settings_in
from ..errors import BakeError
from ..images.storage import IMAGE_STORAGES, Storage
from ..rights import RIGHTS, Rights

_MOST_ANGLES = 1024
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class SourceRecord:
    """Source of a bake.

    Attributes
    ----------
    name : of the measurement, of the model or of the swatch
    facts : what the reader found, as free in form as the readers are many; empty where none are told
    entries : all of it, as `bake.bundle.origin` compares sources
    """

    name: str
    facts: Mapping[str, Any]
    entries: Mapping[str, Any]

    @property
    def format(self) -> str | None:
        """Format of the measurement's file, where it is known."""
        found = self.facts.get("format")
        return found if isinstance(found, str) else None

    @classmethod
    def parse(cls, fields: Fields) -> SourceRecord:
        """Read from a bundle's "source". Raises BakeError."""
        about = fields.entries.get("facts")
        return cls(fields.text("name"), about if isinstance(about, dict) else {}, fields.entries)


def rights_of(fields: Fields) -> Rights:
    """A bundle's "rights"; empty where none were stated, as in older ones. Raises BakeError."""
    if not fields.has("rights"):
        return Rights()
    told = fields.part("rights")
    with settings_in(fields.where):
        return Rights(**{name: told.text(name) for name in RIGHTS if told.has(name)})


@dataclass(frozen=True)
class ImageRecord:
    """An image of the bundle; `file_bytes` is known of a material's own copy only."""

    width: int
    height: int
    channels: int
    storage: Storage
    sha256: str
    file_bytes: int | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in texels."""
        return self.width, self.height

    def render_bytes(self, packed: bool) -> int:
        """Bytes in memory while rendering, read from a file or, if packed, from inside a .blend."""
        return self.width * self.height * self.storage.render_bytes(self.channels, packed)

    @classmethod
    def parse(cls, fields: Fields) -> ImageRecord:
        """Read from an entry of a bundle's "images". Raises BakeError."""
        width, height, channels = (fields.whole(key, 1, 1 << 24) for key in ("width", "height", "channels"))
        storage = Storage(fields.text("storage", choices=[str(kind) for kind in IMAGE_STORAGES]))
        file_bytes = fields.whole("file_bytes", 0) if fields.has("file_bytes") else None
        return cls(width, height, channels, storage, fields.text("sha256"), file_bytes)


def images_of(fields: Fields) -> dict[str, ImageRecord]:
    """All of a document's "images" by name. Raises BakeError."""
    images = fields.part("images")
    return {name: ImageRecord.parse(images.part(name)) for name in images.entries}


def check_size(images: Mapping[str, ImageRecord], name: str, size: tuple[int, int], fields: Fields) -> None:
    """Raise BakeError where the bundle holds an image of this name that has another size."""
    found = images[name].size if name in images else size
    if found != size:
        cause = f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}"
        raise BakeError(fields.where, cause, "bake it again")


@dataclass(frozen=True)
class AlbedoRecord:
    """Share of the light that is reflected.

    Attributes
    ----------
    theta_o_deg : (n,) viewing angles in degrees
    directional : (n, 3) directional albedo at each
    white_sky : (3,) of a uniform sky
    largest : of `directional`
    above_one_deg : viewing angles at which a channel reflects more than arrives
    """

    theta_o_deg: tuple[float, ...]
    directional: tuple[Colour, ...]
    white_sky: Colour
    largest: float
    above_one_deg: tuple[float, ...]

    @property
    def under_sky(self) -> Colour:
        """Of a uniform sky, in [0, 1]: the material's colour as a whole, of a sheen too, which is dark from above."""
        red, green, blue = (min(max(value, 0.0), 1.0) for value in self.white_sky)
        return red, green, blue

    @classmethod
    def parse(cls, document: Fields, key: str) -> AlbedoRecord:
        """Read from the entry `key` of a document, as `bake.tables.albedo.albedo_facts` made it. Raises BakeError."""
        fields = document.part(key)
        try:
            degrees = fields.numbers("theta_o_deg", (1, _MOST_ANGLES))
            directional: Any = fields.rows("directional", (len(degrees), len(degrees)), 3)
            white_sky: Any = fields.numbers("white_sky", (3, 3))
            above = fields.numbers("above_one_deg", (0, _MOST_ANGLES))
            return cls(degrees, directional, white_sky, fields.number("largest"), above)
        except BakeError as error:
            # Keys alone would not say whether the table's or the measurement's is meant.
            raise BakeError(error.file, f"'{key}': {error.cause}", error.remedy) from error


@dataclass(frozen=True)
class EffectRecord:
    """Something that a graph holds or omits, and why."""

    name: str
    kept: bool
    why: str


@dataclass(frozen=True)
class RenderingRecord:
    """How a material was built, as far as its own copy of the facts says so; nothing in a bundle.

    Attributes
    ----------
    choices, effects : what an artist has chosen, and what came of it
    brightened : gloss, and how much more is reflected at it than at 1 to viewers at the angles of `AlbedoRecord`
    brightened_behind : the same of the back of a sheet whose sides differ
    pixels : of a swatch whose texels are averaged by distance: pixels of a texel that is a unit of its UV map over the
        texels of that, at a distance of 1; 0 of all others
    joined : of a swatch whose texels were joined for good: pixels across a texel from which on that is seen; 0 of all
        others
    closest : by each mesh that wore it then, `Units.pixels` in texels of its UV map's unit up to which no texel of the
        mesh is as large as that
    """

    choices: Mapping[str, str] = field(default_factory=dict)
    effects: tuple[EffectRecord, ...] = ()
    brightened: tuple[tuple[float, tuple[Colour, ...]], ...] = ()
    brightened_behind: tuple[tuple[float, tuple[Colour, ...]], ...] = ()
    pixels: float = field(default=0.0, kw_only=True)
    joined: float = field(default=0.0, kw_only=True)
    closest: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    @classmethod
    def parse(cls, found: object) -> RenderingRecord:
        """Read from a material's "rendering"; what cannot be read is left out, for it is only told."""
        given = found if isinstance(found, dict) else {}
        choices, effects, closest = given.get("choices"), given.get("effects"), given.get("closest")
        closest = closest if isinstance(closest, dict) else {}
        return cls(
            {key: v for key, v in choices.items() if isinstance(v, str)} if isinstance(choices, dict) else {},
            tuple(
                EffectRecord(str(entry.get("name", "")), entry.get("kept") is True, str(entry.get("why", "")))
                for entry in (effects if isinstance(effects, list) else [])
                if isinstance(entry, dict)
            ),
            _brightened_of(given.get("brightened")),
            _brightened_of(given.get("brightened_behind")),
            **{name: float(n) for name in ("pixels", "joined") if isinstance(n := given.get(name), int | float)},
            closest={name: float(n) for name, n in closest.items() if isinstance(n, int | float)},
        )


def _brightened_of(found: object) -> tuple[tuple[float, tuple[Colour, ...]], ...]:
    """Empty where any of it is not as `gloss_energy.brightened_by_gloss` gave it."""
    try:
        entries = [] if not isinstance(found, list) else found
        return tuple(
            (float(gloss), tuple((float(r), float(g), float(b)) for r, g, b in rows)) for gloss, rows in entries
        )
    except (TypeError, ValueError):
        return ()


def kind_of(document: Mapping[str, Any]) -> str:
    """The kind that a document says it is of; empty where it does not."""
    kind = document.get("kind")
    return kind if isinstance(kind, str) else ""


@dataclass(frozen=True)
class BundleRecord(ABC):
    """All that is known of a baked material; pixels are loaded by methods only.

    Attributes
    ----------
    where : the place that errors name
    rights : author, licence and source as they were stated
    images : by the names of `bake.bundle.bundle.IMAGES`
    packed, rendering : of a material's own copy: whether its textures lie in the .blend, and how it was built
    document : as it was read, to be written again
    bundle : that holds the images; None for a material's own copy, which has no files
    """

    kind: ClassVar[Kind]
    kind_words: ClassVar[str]

    where: str | Path
    source: SourceRecord
    rights: Rights
    images: Mapping[str, ImageRecord]
    packed: bool
    rendering: RenderingRecord
    document: Mapping[str, Any] = field(repr=False, compare=False)
    bundle: Bundle | None = field(repr=False, compare=False)

    @classmethod
    def read(cls, bundle: Bundle) -> Self:
        """Read the record of a bundle. Raises BakeError where it is of another kind, or an entry is missing or
        wrong."""
        return cls.parse(bundle.material, bundle.path / MATERIAL, bundle)

    @classmethod
    def of(cls, source: Bundle | Self) -> Self:
        """The record of a bundle, or the one that was read already. Raises BakeError as `read`."""
        return cls.read(source) if isinstance(source, Bundle) else source

    @classmethod
    def parse(cls, document: Mapping[str, Any], where: str | Path, bundle: Bundle | None = None) -> Self:
        """Read a document from anywhere, named `where` in errors. Raises BakeError as `read`."""
        fields = Fields(document, where)
        if (kind := fields.text("kind")) != cls.kind:
            raise BakeError(where, f"kind {kind!r:.40} is not {cls.kind_words}", "update the extension")
        images = images_of(fields)
        return cls(
            **cls._parts(fields, images),
            where=where,
            source=SourceRecord.parse(fields.part("source")),
            rights=rights_of(fields),
            images=images,
            packed=document.get("packed") is True,
            rendering=RenderingRecord.parse(document.get("rendering")),
            document=document,
            bundle=bundle,
        )

    @classmethod
    @abstractmethod
    def _parts(cls, fields: Fields, images: Mapping[str, ImageRecord]) -> Mapping[str, Any]:
        """The fields that only this kind has, by name. Raises BakeError."""

    @property
    def name(self) -> str:
        """Name of what was measured or photographed."""
        return self.source.name

    def has(self, image: str) -> bool:
        """Whether there is an image of this name."""
        return image in self.images

    def files(self) -> Bundle:
        """The bundle with the images. Raises BakeError where this record is of a document alone."""
        if self.bundle is None:
            raise BakeError(self.where, "has no images of its own", "give the bundle")
        return self.bundle

"""JSON of a bundle: strict in what is written, and untrusting of what is read."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import BakeError

MAX_JSON_BYTES = 4 << 20
_REMEDY = "bake it again"
_NAMES = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    list: "a list",
    dict: "an object",
}
T = TypeVar("T")


def dump_json(document: Mapping[str, Any], file: str | Path, limit: int | None = MAX_JSON_BYTES) -> str:
    """Sorted, indented JSON whose floats read back equal; numpy scalars and arrays become plain numbers.

    Raises BakeError for NaN, infinity, keys that are not texts, and anything JSON has no word for, naming
    where it stands, and for more than `limit` letters, by default what `load_json` takes; `file` is the name shown.
    """
    text = json.dumps(_plain(document, "", file), sort_keys=True, indent=2, allow_nan=False) + "\n"
    if limit is not None and len(text) > limit:
        raise BakeError(file, f"would exceed {limit >> 20} MiB", "keep fewer facts")
    return text


def _plain(value: Any, where: str, file: str | Path) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise BakeError(file, f"'{where}' has the key {key!r}, not a text", "use texts as keys")
        return {key: _plain(item, f"{where}.{key}" if where else key, file) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{k}]", file) for k, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise BakeError(file, f"'{where}' is {value}, which JSON cannot hold", "fix the value")
    if value is not None and not isinstance(value, bool | int | float | str):
        raise BakeError(file, f"'{where}' holds a {type(value).__name__}", "use plain numbers and texts")
    return value


def load_json(file: Path, limit: int = MAX_JSON_BYTES) -> dict[str, Any]:
    """A JSON object of at most `limit` bytes without NaN, infinity, overflowing numbers or repeated keys.

    Raises BakeError, also where the file is not an ordinary one.
    """
    try:
        if file.is_symlink() or not file.is_file():
            raise BakeError(file, "is missing or not an ordinary file", _REMEDY)
        with open(file, "rb") as stream:
            data = stream.read(limit + 1)
    except OSError as error:
        raise BakeError(file, f"cannot be read ({error.strerror})", "check its permissions") from error
    if len(data) > limit:
        raise BakeError(file, f"is larger than {limit >> 20} MiB", _REMEDY)
    try:
        document = json.loads(
            data.decode("utf-8"),
            parse_constant=_refuse_constant,
            parse_float=_finite,
            object_pairs_hook=_unique,
        )
    except RecursionError as error:
        raise BakeError(file, "is nested too deeply", _REMEDY) from error
    except ValueError as error:  # also what the decoder of text, and of numbers too long, raise
        raise BakeError(file, f"is not valid JSON ({str(error)[:120]})", _REMEDY) from error
    if not isinstance(document, dict):
        raise BakeError(file, "is not a JSON object", _REMEDY)
    return document


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"holds {name}")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"number {text[:20]} is too large")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key is repeated")
    return found


def require(
    mapping: Mapping[str, Any],
    key: str,
    expected: type[T],
    where: str | Path,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Collection[Any] | None = None,
) -> T:
    """The value under `key`, checked; for content that came from a file.

    Parameters
    ----------
    expected : bool, int, float, str, list or dict; a whole number also serves as float, true as neither
    where : shown as the place, for instance the file and the object in it
    minimum, maximum : inclusive bounds of a number, or of the length of a text, list or object
    choices : the values allowed

    Raises BakeError naming the key.
    """
    if not isinstance(mapping, Mapping) or key not in mapping:
        raise BakeError(where, f"'{key}' is missing", _REMEDY)
    value: Any = mapping[key]
    if expected is float and type(value) is int and abs(value) < 1 << 1000:
        value = float(value)
    found: object = type(value)
    if found is not expected or (expected is float and not math.isfinite(value)):
        raise BakeError(where, f"'{key}' is not {_NAMES.get(expected, expected.__name__)}", _REMEDY)
    size = len(value) if isinstance(value, str | list | dict) else value
    what = f"'{key}'" if size is value else f"the length of '{key}'"
    if minimum is not None and size < minimum:
        raise BakeError(where, f"{what} is {_shown(size)}, below {minimum}", _REMEDY)
    if maximum is not None and size > maximum:
        raise BakeError(where, f"{what} is {_shown(size)}, above {maximum}", _REMEDY)
    if choices is not None and value not in choices:
        allowed = ", ".join(map(str, choices))
        raise BakeError(where, f"'{key}' is {_shown(value)}, not one of {allowed}", _REMEDY)
    checked: T = value
    return checked


@dataclass(frozen=True)
class Fields:
    """An object of an untrusted document, read entry by entry; every method raises BakeError that names `where`.

    `least` and `most` are inclusive bounds of a number, or of how many entries a list has.
    """

    entries: Mapping[str, Any]
    where: str | Path

    def has(self, key: str) -> bool:
        """Whether there is an entry of this name that is not null."""
        return self.entries.get(key) is not None

    def text(self, key: str, choices: Collection[Any] | None = None) -> str:
        """A text, one of the choices if there are any."""
        return require(self.entries, key, str, self.where, choices=choices)

    def flag(self, key: str) -> bool:
        """True or false."""
        return require(self.entries, key, bool, self.where)

    def whole(self, key: str, least: float | None = None, most: float | None = None) -> int:
        """A whole number."""
        return require(self.entries, key, int, self.where, least, most)

    def number(self, key: str, least: float | None = None, most: float | None = None) -> float:
        """A finite number."""
        return require(self.entries, key, float, self.where, least, most)

    def part(self, key: str) -> Fields:
        """An object inside this one."""
        return Fields(require(self.entries, key, dict, self.where), self.where)

    def parts(self, key: str, least: int, most: int) -> tuple[Fields, ...]:
        """A list of objects."""
        listed = require(self.entries, key, list, self.where, least, most)
        if not all(isinstance(entry, dict) for entry in listed):
            raise BakeError(self.where, f"'{key}' lists something that is no object", _REMEDY)
        return tuple(Fields(entry, self.where) for entry in listed)

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts."""
        listed = require(self.entries, key, list, self.where)
        return tuple(require({key: entry}, key, str, self.where) for entry in listed)

    def numbers(
        self, key: str, count: tuple[int, int], least: float | None = None, most: float | None = None
    ) -> tuple[float, ...]:
        """A list of finite numbers; `count` bounds how many."""
        listed = require(self.entries, key, list, self.where, *count)
        return tuple(require({key: entry}, key, float, self.where, least, most) for entry in listed)

    def wholes(
        self, key: str, count: tuple[int, int], least: float | None = None, most: float | None = None
    ) -> tuple[int, ...]:
        """A list of whole numbers; `count` bounds how many."""
        listed = require(self.entries, key, list, self.where, *count)
        return tuple(require({key: entry}, key, int, self.where, least, most) for entry in listed)

    def rows(
        self,
        key: str,
        count: tuple[int, int],
        columns: int,
        least: float | None = None,
        most: float | None = None,
    ) -> tuple[tuple[float, ...], ...]:
        """A list of lists of `columns` finite numbers each; `count` bounds how many lists."""
        listed = require(self.entries, key, list, self.where, *count)
        each = (Fields({key: row}, self.where) for row in listed)
        return tuple(row.numbers(key, (columns, columns), least, most) for row in each)


@contextlib.contextmanager
def settings_in(where: str | Path) -> Iterator[None]:
    """Inside, settings are made of what a document says: a BakeError of one names document and setting."""
    try:
        yield
    except BakeError as error:
        if error.file == str(where):
            raise
        raise BakeError(where, f"'{error.file}' {error.cause}", _REMEDY) from error


def _shown(value: Any) -> str:
    """Short enough for one line whatever a hostile file holds; a number too long for `str` included."""
    if isinstance(value, int) and value.bit_length() > 100:
        return "a huge number"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."

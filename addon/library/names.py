"""Names of the bundles in one folder: none twice, whatever the file system makes of capitals and accents."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ...bake.bundle.bundle import SUFFIX
from ...bake.errors import BakeError
from ...bake.sources.lookup.text_file import file_name_of

# Letters of a name that is made of a formula's parameters; file systems hold 255 bytes.
_LONGEST = 80
_DIGITS = 6
_REFUSED = frozenset('/\\:*?"<>|')
# Devices on Windows, whatever stands behind a dot.
_PORTS = frozenset(f"{port}{digit}" for port in ("com", "lpt") for digit in "0123456789¹²³")
_DEVICES = _PORTS | {"con", "prn", "aux", "nul", "conin$", "conout$"}


@dataclass(frozen=True)
class Wanted:
    """What a bundle would be called.

    Parameters
    ----------
    stem : its name where nobody else wants it
    qualified : a longer name, for instance with the folder that the source lies in
    identity : hexadecimal digits that the source alone has
    given : the name that was asked for, "" where none was
    title : of the source, for errors
    """

    stem: str
    qualified: str
    identity: str
    given: str = ""
    title: str = ""


@dataclass(frozen=True)
class Earlier:
    """A name that a source had before.

    Parameters
    ----------
    ours : whether the library has baked the bundle of that name from this very source, so that it is the library's own
        to bake again
    """

    name: str
    ours: bool


def name_key(name: str) -> str:
    """What two names share that are one to some file system: case, or a letter and its accent in a row."""
    return unicodedata.normalize("NFC", name).casefold()


def still_theirs(earlier: Mapping[str, Earlier], now: Mapping[str, Earlier]) -> dict[str, Earlier]:
    """Names of earlier sources that are not among those of now, but for what has become another source's own."""
    passed = {name_key(one.name) for one in now.values() if one.ours}
    left = {identity: one for identity, one in earlier.items() if identity not in now}
    return {identity: one for identity, one in left.items() if name_key(one.name) not in passed}


def unique_names(wanted: Sequence[Wanted], kept: Mapping[str, Earlier] | None = None) -> list[str]:
    """A name for each, all different, the same whatever their order.

    Where several want one stem, each takes its longer name, or where that is not its own either, digits of its
    identity. `kept` are the names that identities have had before; they stay theirs.

    Raises
    ------
    BakeError : one name was asked for twice, or is none for a file; a source that has no name of its own comes twice
    """
    chosen = [_given(one) for one in wanted]
    _refuse_twice(wanted, chosen)
    nameless = Counter(one.identity for one, name in zip(wanted, chosen) if not name)
    for one in wanted:
        if nameless[one.identity] > 1:
            raise BakeError(one.title or one.stem, "is given twice with different settings", "give each its own --name")
    taken = {name_key(name) for name in chosen if name}
    for k, one in enumerate(wanted):
        before = kept[one.identity].name if kept and one.identity in kept else ""
        if not chosen[k] and _is_plain(before) and name_key(before) not in taken:
            chosen[k] = before
            taken.add(name_key(before))
    for choices in _in_turn(wanted):
        open_ = [k for k, name in enumerate(chosen) if not name]
        count = Counter(name_key(choices[k]) for k in open_)
        for k in open_:
            if count[name_key(choices[k])] == 1 and name_key(choices[k]) not in taken:
                chosen[k] = choices[k]
        taken |= {name_key(name) for name in chosen if name}
    return chosen


def _in_turn(wanted: Sequence[Wanted]) -> Iterable[list[str]]:
    """Names of all, the shortest first."""
    stems = [_made_plain(one.stem) for one in wanted]
    yield stems
    longer = [_made_plain(one.qualified) for one in wanted]
    # One that is cut may be another's.
    yield [name[:_LONGEST].rstrip(" .") or stem for name, stem in zip(longer, stems)]
    for digits in range(_DIGITS, max((len(one.identity) for one in wanted), default=0) + 1):
        yield [f"{stem}-{one.identity[:digits]}" for one, stem in zip(wanted, stems)]


def _given(one: Wanted) -> str:
    name = one.given[: -len(SUFFIX)] if one.given.lower().endswith(SUFFIX) else one.given
    if one.given and not _is_plain(name):
        cause = f"cannot be called {one.given[:60]!r}, which is no plain name of a file"
        remedy = 'give a name without any of / \\ : * ? " < > | in it, and no device of Windows, such as CON or NUL'
        raise BakeError(one.title or one.stem, cause, remedy)
    return name


def _is_plain(name: str) -> bool:
    """Whether this names a file on every system, and none that is hidden or lies elsewhere."""
    return name == name.strip(" .") != "" and name.isprintable() and not _REFUSED & set(name) and not _is_device(name)


def _is_device(name: str) -> bool:
    return name.partition(".")[0].rstrip().casefold() in _DEVICES


def _made_plain(name: str) -> str:
    plain = name if _is_plain(name) else file_name_of(name) or "material"
    return f"material-{plain}" if _is_device(plain) else plain


def _refuse_twice(wanted: Sequence[Wanted], chosen: Sequence[str]) -> None:
    seen: dict[str, str] = {}
    for one, name in zip(wanted, chosen):
        if not name:
            continue
        if name_key(name) in seen:
            title = one.title or one.stem
            cause = f"is to be called {name}, as {seen[name_key(name)]} is"
            raise BakeError(title, cause, "give each its own --name")
        seen[name_key(name)] = one.title or one.stem

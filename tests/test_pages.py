"""Pages for people: their commands are right, their pictures small and of the sizes that are asked for."""

from __future__ import annotations

import re
import shlex
import struct
from pathlib import Path

import pytest
from measured_materials.addon.cli.main import parser
from measured_materials.bake.sources.analytic import by_name

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "addon" / "docs"
PAGES = sorted(DOCS.glob("*.md"))
_COMMAND = re.compile(r"(?:\./run cli|--command measured_materials) ([a-z][^`\n|]*)")


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_commands_of_a_page_are_taken(page: Path) -> None:
    """By the parser; dots stand for what the reader gives."""
    commands = [found for found in _COMMAND.findall(page.read_text(encoding="utf-8")) if "..." not in found]
    for command in commands:
        parser().parse_args([word for word in shlex.split(command, comments=True) if word != "\\"])
    assert commands or page.stem in {"formats", "glossary", "hard_cases", "method", "tutorial_measurement"}


def test_formulas_of_the_gallery_are_taken() -> None:
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    commands = [parser().parse_args(shlex.split(line, comments=True)) for line in _COMMAND.findall(text)[:5]]
    models = [given for command in commands for given in command.analytic]
    assert len(models) == 5 and len({model[0] for model in models}) >= 3
    for name, *pairs in models:
        given = {key: [float(v) for v in value.split(",")] for key, value in (pair.split("=") for pair in pairs)}
        assert by_name(name, **{key: tuple(v) if len(v) > 1 else v[0] for key, v in given.items()})


def test_pictures_are_shown_and_small() -> None:
    shown = {
        name
        for page in [ROOT / "README.md", *PAGES]
        for name in re.findall(r"([\w.]+\.(?:jpg|png))\)", page.read_text())
    }
    there = {file.name for file in DOCS.iterdir() if file.suffix in {".jpg", ".png"}}
    assert there == shown
    assert not [name for name in there if (DOCS / name).stat().st_size > 320_000]


def test_every_picture_has_its_maker() -> None:
    """A window's, a swatch's, a bench's or the demo's."""
    made = " ".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests" / "pages").glob("*.py"))
    by_others = {"demo.jpg", "arc.jpg", "engine.png", "cost.png", "bases.png"}
    for file in DOCS.glob("*.*g"):
        assert file.name in by_others or file.stem in made, file.name


def test_pictures_for_the_platform_have_the_sizes_it_asks_for() -> None:
    found = {file.name: size_of(file.read_bytes()) for file in (DOCS / "store").iterdir()}
    assert found.items() <= {"icon.png": (256, 256), "featured.jpg": (1920, 1080)}.items() and "icon.png" in found


def size_of(data: bytes) -> tuple[int, int]:
    """Width and height of a PNG or of a baseline JPEG."""
    if data.startswith(b"\x89PNG"):
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    at = 2
    while data[at + 1] not in (0xC0, 0xC1, 0xC2):
        at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]
    height, width = struct.unpack(">HH", data[at + 5 : at + 9])
    return width, height

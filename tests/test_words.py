"""The words that a user reads: whole and capitalised, of the glossary, and no wider than where they stand."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import pytest

ROOT = Path(measured_materials.__file__).parent
# The workshop's words, for which the glossary has others.
WORKSHOP = re.compile(
    r"\b(closures?|residuals?|envelopes?|alias tables?|f_r|sigma|a_max|held-out|stochastic|mend(?:s|ed|ing)?|"
    r"(?-i:on an Arc|Import Arc))\b",
    re.IGNORECASE,
)
# Where the words of the paper are what is meant: nodes for those who know it.
_NODES = "add_cosine_lobe"
# At a width of 300 pixels and 6 a letter, as `wrapped_text` counts without a window: names left of their values, values
# in a list of choices, and buttons.
_NAME, _CHOICE, _BUTTON = 17, 22, 38
_OURS = re.compile(r"MEASURED_MATERIALS_")
_GROUPS = ("Quality", "Lighting", "BRDF bake", "photographs")


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    measured_materials.register()
    yield
    measured_materials.unregister()


def classes() -> list[Any]:
    """Everything of ours that Blender shows."""
    kinds = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup, bpy.types.Menu, bpy.types.FileHandler)
    found = {cls for kind in kinds for cls in _below(kind) if _OURS.match(cls.__name__)}
    return sorted((cls for cls in found if cls.is_registered), key=lambda cls: cls.__name__)


def _below(cls: Any) -> Iterator[Any]:
    for one in cls.__subclasses__():
        yield one
        yield from _below(one)


def properties() -> Iterator[tuple[str, Any]]:
    """Those that are ours and shown, by the place they have."""
    for cls in classes():
        own = {name for base in cls.__mro__ for name in getattr(base, "__annotations__", ())}
        for prop in cls.bl_rna.properties:
            if prop.identifier in own and not prop.is_hidden:
                yield f"{cls.__name__}.{prop.identifier}", prop


def shown() -> Iterator[tuple[str, str]]:
    """Every label, name and description that Blender shows of ours, by the place it has."""
    for cls in classes():
        if label := getattr(cls, "bl_label", ""):
            yield f"{cls.__name__}.bl_label", label
        if issubclass(cls, bpy.types.Operator):
            yield f"{cls.__name__} description", cls.bl_rna.description
    for place, prop in properties():
        yield f"{place} name", prop.name
        yield f"{place} description", prop.description
        for item in getattr(prop, "enum_items_static", ()) if prop.type == "ENUM" else ():
            yield f"{place} {item.identifier} name", item.name
            yield f"{place} {item.identifier} description", item.description


def test_there_is_something_to_read() -> None:
    assert len(classes()) > 20 and len(list(shown())) > 200


def test_what_is_shown_begins_with_a_capital() -> None:
    wrong = [f"{place}: {text}" for place, text in shown() if text and text[0].isalpha() and not begins_well(text)]
    assert not wrong


def begins_well(text: str) -> bool:
    """Whether it begins with a capital, or with a name that is written otherwise."""
    return text[0].isupper() or text.startswith(("cos^n", "sRGB"))


def test_descriptions_say_something_and_do_not_end_in_a_full_stop() -> None:
    """Blender adds the full stop itself."""
    told = [(place, text) for place, text in shown() if place.endswith("description")]
    assert not [f"{place}: {text}" for place, text in told if text.endswith(".")]
    silent = [place for place, prop in properties() if not prop.description]
    assert not silent


def test_no_word_of_the_workshop_is_shown() -> None:
    wrong = [f"{place}: {text}" for place, text in shown() if WORKSHOP.search(text) and _NODES not in place]
    assert not wrong


def test_every_name_fits_its_place() -> None:
    """Of what stands in panels, at the width that they have at first."""
    groups = [cls for cls in classes() if issubclass(cls, bpy.types.PropertyGroup)]
    assert len(groups) >= 4
    named = [(place, prop) for place, prop in properties() if place.split(".")[0] in {c.__name__ for c in groups}]
    wide = [f"{place}: {prop.name}" for place, prop in named if len(prop.name) > _NAME and prop.type != "BOOLEAN"]
    choices = [
        f"{place}: {item.name}"
        for place, prop in named
        if prop.type == "ENUM"
        for item in prop.enum_items_static
        if len(item.name) > _CHOICE
    ]
    buttons = [cls.bl_label for cls in classes() if issubclass(cls, bpy.types.Operator) and len(cls.bl_label) > _BUTTON]
    assert not wide + choices + buttons


# --- what is said -----------------------------------------------------------------------------------------

SAID = ("addon/ui", "addon/scene_check", "addon/summary", "addon/assets", "addon/material")


def sentences(file: Path) -> Iterator[tuple[int, str]]:
    """Texts of a source that hold a space or a capital: keys of tables and names of images do not. No docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    documents = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
            if re.search(r"[ A-Z]", node.value):
                yield node.lineno, node.value


def of_options(text: str) -> str:
    """Without options of the command line and parameters of formulas, which have names of their own."""
    return re.sub(r"--[a-z_-]+|\b[a-z_0-9]+=", "", text)


def test_no_message_has_a_word_of_the_workshop() -> None:
    files = [file for folder in SAID for file in sorted((ROOT / folder).rglob("*.py")) if file.stem != _NODES]
    assert len(files) > 50
    kept = {"Residual by mirror"}  # read from materials that were built before
    wrong = [
        f"{file.relative_to(ROOT)}:{line}: {text}"
        for file in files
        for line, text in sentences(file)
        if WORKSHOP.search(of_options(text)) and text not in kept
    ]
    assert not wrong


def test_a_message_of_the_workshop_would_be_seen(tmp_path: Path) -> None:
    file = tmp_path / "x.py"
    file.write_text('"""The residual."""\nd = {"residual": 1}\nprint(f"The residual is {d}")\n')
    assert [text for _, text in sentences(file) if WORKSHOP.search(text)] == ["The residual is "]


def test_reports_are_sentences() -> None:
    """What an operator reports begins with a capital, as far as its first words are in the source."""
    wrong = []
    for file in sorted((ROOT / "addon/ui").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "report" and len(node.args) == 2:
                text = first_words(node.args[1])
                if text and text[0].islower():
                    wrong.append(f"{file.relative_to(ROOT)}:{node.lineno}: {text}")
    assert not wrong


def first_words(node: ast.expr) -> str:
    """The beginning of a text, empty where it is put together."""
    if isinstance(node, ast.JoinedStr) and node.values:
        return first_words(node.values[0])
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


# --- pages ------------------------------------------------------------------------------------------------


def test_the_glossary_has_every_word_that_stands_for_one_of_the_workshop() -> None:
    text = (ROOT / "addon/docs/glossary.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in text.splitlines() if line[:1] == "|"]
    assert len(rows) > 20 and all(len(row) == 3 for row in rows)
    told = " ".join(row[2] for row in rows)
    for word in ("f_r", "sigma", "a_max", "residual", "closures", "envelope", "held-out", "slice", "stochastic mirror"):
        assert word in told, word
    read = " ".join(f"{row[0]} {row[1]}" for row in rows)
    assert not WORKSHOP.findall(read)


def test_names_in_the_glossary_are_those_of_the_panels() -> None:
    text = (ROOT / "addon/docs/glossary.md").read_text(encoding="utf-8")
    names = {prop.name for _, prop in properties()} | {getattr(cls, "bl_label", "") for cls in classes()}
    told = ("Mode", "Aim at Lights", "Sample Lamps", "Base Reflection", "Strength", "Brightest", "Stabilise", "Fix")
    told += ("Quiet Camera", "Denoise by Materials", "Swatch Detail", "Bake Again", "Light Directions")
    for name in told:
        assert name in names and f"| {name} |" in text, name


def test_messages_of_the_troubleshooting_page_are_those_of_the_bake() -> None:
    text = (ROOT / "addon/docs/troubleshooting.md").read_text(encoding="utf-8")
    part = text.split("## The bake says no")[1].split("##")[0]
    messages = [line.split("|")[1].strip() for line in part.splitlines() if line.startswith("| ")][1:]
    assert len(messages) >= 10
    source = " ".join(" ".join(file.read_text(encoding="utf-8").split()) for file in (ROOT / "bake").rglob("*.py"))
    source += " ".join(file.read_text(encoding="utf-8") for file in (ROOT / "addon/material").rglob("*.py"))
    for message in messages:
        found = re.sub(r" \(.*", "", message).replace("gives a photograph", "gives {path.name}")
        assert found in source, message


@pytest.mark.parametrize("page", ["tutorial_measurement", "tutorial_photographs", "gallery", "troubleshooting"])
def test_pages_for_people_have_no_word_of_the_workshop(page: str) -> None:
    text = (ROOT / f"addon/docs/{page}.md").read_text(encoding="utf-8")
    assert not WORKSHOP.findall(of_options(text))

"""The order of the house: what lies at the top, sizes, versions, nothing of anybody's machine."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest
from measured_materials.bake import VERSION

ROOT = Path(__file__).resolve().parents[1]
TOP = {
    "addon", "nodes", "bake", "tests", "findings", ".ci",
    "__init__.py", "__main__.py", "blender_manifest.toml", "pyproject.toml", "run",
    "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE",
    ".gitattributes", ".gitignore",
}  # fmt: skip
LONGEST_FILE = 400
MACHINE_PATHS = re.compile("|".join(rf"(?<![\w.])/{name}/" for name in ("work", "root", r"home/\w", r"Users/\w")))


@cache
def ignored_names() -> tuple[str, ...]:
    lines = (ROOT / ".gitignore").read_text().split()
    return (".git", *(line.strip("/") for line in lines))


def is_ignored(path: Path) -> bool:
    return any(fnmatch(path.name, pattern) for pattern in ignored_names())


def text_files(folder: Path = ROOT) -> Iterator[tuple[Path, str]]:
    for path in sorted(folder.iterdir()):
        if is_ignored(path) or path.is_symlink():
            continue
        if path.is_dir():
            yield from text_files(path)
        elif b"\0" not in (data := path.read_bytes()):
            yield path, data.decode("utf-8", "replace")


def test_top_level_holds_only_what_belongs_there() -> None:
    assert {path.name for path in ROOT.iterdir() if not is_ignored(path)} - TOP == set()


def test_every_text_file_is_utf8_without_a_machine_path() -> None:
    wrong = []
    for path, text in text_files():
        for number, line in enumerate(text.splitlines(), 1):
            if MACHINE_PATHS.search(line) or "\N{REPLACEMENT CHARACTER}" in line:
                wrong.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not wrong


@pytest.mark.parametrize(
    "text, found", [("/ro" + "ot/x", True), ("../wo" + "rk/x", False), ("/net" + "/wo" + "rk/x", False)]
)
def test_machine_path_pattern(text: str, found: bool) -> None:
    assert bool(MACHINE_PATHS.search(text)) is found


def test_source_files_stay_readable() -> None:
    lengths = {
        str(path.relative_to(ROOT)): text.count("\n")
        for path, text in text_files()
        if path.suffix in {".py", ".osl", ".h"}
    }
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


def test_one_version_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert manifest["version"] == project["version"] == VERSION
    assert manifest["id"] == project["name"]
    assert f"## [{project['version']}]" in (ROOT / "CHANGELOG.md").read_text()


def test_packages_are_listed_completely() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    found = {"measured_materials": "."}
    for folder in ("addon", "bake", "nodes"):
        for init in (ROOT / folder).rglob("__init__.py"):
            place = init.parent.relative_to(ROOT)
            found[".".join(("measured_materials", *place.parts))] = place.as_posix()
    assert setuptools["package-dir"] == found
    assert sorted(setuptools["packages"]) == sorted(found)


def test_constraints_pin_every_dependency_exactly() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    lines = (ROOT / "tests" / "constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    for requirement in (line for extra in extras.values() for line in extra):
        name, version = requirement.split("==")
        # bpy differs between the two environments, hence it is pinned by the extras alone.
        assert name == "bpy" or pins[name] == version


@pytest.mark.parametrize("script", ["run", ".ci/run"])
def test_scripts_are_executable_and_parse(script: str) -> None:
    path = ROOT / script
    shell = path.read_text().splitlines()[0].split("/")[-1].split()[-1]
    assert path.stat().st_mode & 0o111
    subprocess.run([shell, "-n", str(path)], check=True, timeout=20)


@pytest.mark.parametrize(
    "arguments, code, word",
    [
        ([], 0, "Usage"),
        (["--help"], 0, "Usage"),
        (["tset"], 2, "unknown command 'tset'"),
        (["test", "--blender", "9.9"], 2, "takes 4.5 or 5.0"),
        (["--blender"], 2, "takes 4.5 or 5.0"),
    ],
)
def test_run_explains_itself(arguments: list[str], code: int, word: str, tmp_path: Path) -> None:
    done = subprocess.run([str(ROOT / "run"), *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=20)
    assert done.returncode == code
    assert word in done.stdout + done.stderr


def test_python_of_the_tests_is_the_one_blender_ships() -> None:
    assert sys.version_info[:2] == (3, 11)


def test_benches_find_what_they_share_with_tests() -> None:
    """A bench is a program of its own: without a word of where the tests are, its imports from `support` fail."""
    sharing = {p: text for p in (ROOT / "tests" / "bench").glob("*.py") if "\nfrom support" in (text := p.read_text())}
    assert sharing
    for path, text in sharing.items():
        assert -1 < text.find("sys.path.insert(") < text.index("\nfrom support"), path.name

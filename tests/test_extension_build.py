"""The zip that users install: accepted by Blender's own tool, complete, and free of development files."""

from __future__ import annotations

import os
import posixpath
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = Path(bpy.utils.resource_path("LOCAL")) / "scripts"
TOP = {
    "__init__.py",
    "blender_manifest.toml",
    "LICENSE",
    "README.md",
    "CHANGELOG.md",
    "addon",
    "bake",
    "nodes",
}
LEFT_OUT = ("tests", "findings", "run", "pyproject.toml", "CONTRIBUTING.md", "__main__.py", "addon/docs/store")
NEEDED = {"__init__.py", "blender_manifest.toml", "LICENSE"}


def blender_ext(*arguments: str | Path) -> str:
    """Run Blender's extension tool, which comes with the wheel; returns what it prints."""
    tool = SCRIPTS / "addons_core/bl_pkg/cli/blender_ext.py"
    command = [sys.executable, str(tool), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def tags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tags Blender knows, in the form its tool requires."""
    known = SCRIPTS / "modules/_bpy_internal/extensions/tags.py"
    file = tmp_path_factory.mktemp("tags") / "tags.py"
    file.write_text(known.read_text() + '\nresult = {"add-on": addons, "theme": themes}\n')
    return file


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extension")
    blender_ext("build", "--source-dir", ROOT, "--output-dir", folder)
    (file,) = folder.glob("*.zip")
    return file


def test_manifest_is_valid(tags: Path) -> None:
    blender_ext("validate", "--valid-tags", tags, ROOT)


def test_zip_is_valid(archive: Path, tags: Path) -> None:
    blender_ext("validate", "--valid-tags", tags, archive)


def test_zip_holds_all_that_runs_and_nothing_else(archive: Path) -> None:
    names = {name for name in zipfile.ZipFile(archive).namelist() if not name.endswith("/")}
    assert {name.split("/")[0] for name in names} <= TOP
    assert NEEDED <= names
    for left_out in LEFT_OUT:
        assert (ROOT / left_out).exists()
        assert not [name for name in names if name == left_out or name.startswith(left_out + "/")], left_out
    sources = {
        path.relative_to(ROOT).as_posix()
        for folder in ("addon", "bake", "nodes")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".osl", ".h", ".json"} and "docs" not in path.parts
    }
    assert sources and sources <= names
    assert not [name for name in names if "__pycache__" in name or "/." in name or name.endswith((".pyc", ".zip"))]


PAGES = ("README.md", "addon/docs/*.md")
_LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def test_every_page_reads_without_the_repository(archive: Path) -> None:
    """Whatever a page in the zip links to, pictures too, is in the zip."""
    names = set(zipfile.ZipFile(archive).namelist())
    folders = {str(PurePosixPath(name).parent) for name in names}
    pages = [name for name in names if any(PurePosixPath(name).match(pattern) for pattern in PAGES)]
    assert len(pages) >= 7
    for page in pages:
        text = zipfile.ZipFile(archive).read(page).decode()
        links = [link for link in _LINK.findall(text) if "://" not in link]
        targets = {link: posixpath.normpath(posixpath.join(posixpath.dirname(page), link)) for link in links}
        assert not [link for link, target in targets.items() if target not in names | folders], page


def test_zip_is_small(archive: Path) -> None:
    # Sources and the pages' small pictures; data that slipped in would be far above.
    assert archive.stat().st_size < 3_000_000


def manifest() -> dict[str, Any]:
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


def test_manifest_tells_what_reviewers_ask_for() -> None:
    """The rules of extensions.blender.org's guidelines that its tool does not check."""
    told = manifest()
    assert told["website"].startswith("https://extensions.blender.org/add-ons/") and told["copyright"]
    assert "blender" not in told["name"].lower() and len(told["tagline"]) <= 64
    assert set(told["permissions"]) == {"files"}, "no network, hence no updater either"


def test_nothing_in_the_zip_reaches_for_the_network(archive: Path) -> None:
    # A pair of sockets within the process wakes it at an interrupt; they connect to nothing.
    imported = r"^\s*(?:import|from) (?:urllib\.request|http|ssl|requests|ftplib|pip)\b"
    wanted = re.compile(rf"{imported}|create_connection\(|\.connect\(\(", re.MULTILINE)
    held = zipfile.ZipFile(archive)
    sources = [name for name in held.namelist() if name.endswith(".py")]
    assert len(sources) > 200 and not [name for name in sources if wanted.search(held.read(name).decode())]


def test_the_oldest_blender_of_the_table_is_that_of_the_manifest() -> None:
    rows = re.findall(r"^\| (\d+\.\d+)(?: LTS)? \|", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert f"{rows[0]}.0" == manifest()["blender_version_min"]


INSTALL = """
import sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(repo="user_default", filepath=sys.argv[1], enable_on_install=True)
name = "bl_ext.user_default.measured_materials"
assert name in bpy.context.preferences.addons, "not enabled after installation"
for _ in range(2):
    bpy.ops.preferences.addon_disable(module=name)
    assert name not in bpy.context.preferences.addons
    bpy.ops.preferences.addon_enable(module=name)
    assert name in bpy.context.preferences.addons, "not enabled again"
assert not [module for module in sys.modules if module.split(".")[0] == "measured_materials"]
print("INSTALLED")
"""


def test_zip_installs_enables_and_enables_again(archive: Path, tmp_path: Path) -> None:
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", INSTALL, str(archive)],
        env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    output = done.stdout + done.stderr
    assert done.returncode == 0 and "INSTALLED" in done.stdout, output
    assert "Traceback" not in output, output

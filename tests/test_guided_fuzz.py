"""`./run fuzz --guided`: a process of its own spoils the files, whose end is the command's."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# As much of atheris as is called, and mutants of one file's first byte; what it is given stands in the environment.
STAND_IN = """
import contextlib, os, sys

@contextlib.contextmanager
def instrument_imports(include):
    yield

def Setup(arguments, one):
    global run, corpus
    run, corpus = one, arguments[1]

def Fuzz():
    (name,) = os.listdir(corpus)
    with open(os.path.join(corpus, name), "rb") as stream:
        data = stream.read()
    for first in range(int(os.environ["FILES"])):
        run(bytes([first]) + data[1:] if first else data)
    if os.environ["END"] == "crash":
        os._exit(77)
    sys.exit(0)
"""


def guided(folder: Path, *arguments: str, path: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command with temporary files in `folder`."""
    call = [sys.executable, str(ROOT / "tests" / "fuzz" / "__main__.py"), "--guided", *arguments]
    env = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": path, **environment}
    return subprocess.run(call, env=env, cwd=folder, capture_output=True, text=True, timeout=300)


def spoiled_folders() -> set[str]:
    memory = Path("/dev/shm")
    return {entry.name for entry in (memory if memory.is_dir() else Path(tempfile.gettempdir())).glob("spoiled*")}


@pytest.mark.parametrize("end", ["well", "crash"])
def test_the_end_of_the_child_is_that_of_the_command_and_its_files_go(end: str, tmp_path: Path) -> None:
    """libFuzzer ends its process however it likes: only the process that waits for it can clean up."""
    (tmp_path / "atheris.py").write_text(STAND_IN)
    (tmp_path / "work").mkdir()
    before = spoiled_folders()
    ended = guided(tmp_path / "work", "published SGD", "--count", "8", path=str(tmp_path), FILES="8", END=end)
    assert ended.returncode == (77 if end == "crash" else 0), ended.stderr
    assert "published SGD: 8 tried" in ended.stdout and "1 read" in ended.stdout
    assert spoiled_folders() <= before and not list((tmp_path / "work").iterdir())


def test_one_format_has_to_be_named(tmp_path: Path) -> None:
    (tmp_path / "atheris.py").write_text(STAND_IN)
    ended = guided(tmp_path, "--count", "8", path=str(tmp_path), FILES="8", END="well")
    assert ended.returncode == 1 and "name one format of" in ended.stderr


@pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None, reason="needs atheris: ./run fuzz --guided installs it"
)
def test_atheris_itself_spoils_files(tmp_path: Path) -> None:
    ended = guided(tmp_path, "published SGD", "--count", "500")
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert "published SGD: 500 tried" in ended.stdout

"""Coverage-guided spoiling of one format's files, by atheris (libFuzzer for Python)."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["measured_materials.bake"]):
    from support import fuzz

LARGEST = 1 << 16


def run(names: list[str], count: int, seed: int = 0) -> None:
    """Read so many mutants of the small file of the one format, and exit as libFuzzer does, which ends its process.

    A crash is anything but BakeError, a hang twenty seconds, a leak two gigabytes; the file of each is kept.
    """
    if len(names) != 1:
        sys.exit(f"run fuzz --guided: name one format of {', '.join(names)}")
    with fuzz.fast_folder() as folder:
        child = os.fork()
        if not child:
            _run(names[0], folder, count, seed)
            os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    sys.exit(status)


def _run(name: str, folder: Path, count: int, seed: int) -> None:
    """In a process of its own."""
    original = fuzz.small_files(folder)[name]
    corpus = folder / "corpus"
    corpus.mkdir()
    shutil.copy(original, corpus)
    path = fuzz.beside(original, folder)
    tried = {"read": 0, "refused": 0}

    def one(data: bytes) -> None:
        path.write_bytes(data)
        tried["read" if fuzz.read_and_look(path) else "refused"] += 1
        if sum(tried.values()) == count:
            print(f"{name}: {count} tried, {tried['refused']} clean errors, {tried['read']} read", flush=True)

    limits = ["-timeout=20", "-rss_limit_mb=2048", f"-max_len={LARGEST}", f"-seed={seed + 1}"]
    kept = f"-artifact_prefix={os.path.abspath(os.curdir)}{os.sep}"
    with fuzz.no_fit():
        atheris.Setup([sys.argv[0], str(corpus), f"-runs={count}", "-print_final_stats=1", kept, *limits], one)
        atheris.Fuzz()

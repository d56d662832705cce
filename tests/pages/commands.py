"""The commands that the pages print, run as they stand there, so that a page cannot promise another picture."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from measured_materials.addon.cli.main import main
from PIL import Image

DOCS = Path(__file__).resolve().parents[2] / "addon" / "docs"
_QUALITY = 80


def commands_of(page: str) -> list[list[str]]:
    """All of `./run cli ...` that stand in a page's indented blocks or tables, as arguments."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return [shlex.split(found) for found in re.findall(r"^    \./run cli (.+)$", text, re.MULTILINE)]


def baked(command: Sequence[str], folder: Path) -> Path:
    """The bundle of a command, under the name that it gives, made unless it is in `folder` already."""
    bundle = folder / command[command.index("--out") + 1]
    if not bundle.exists():
        run(command, bundle)
    return bundle


def run(arguments: Sequence[str], folder: Path) -> None:
    """Run one with its output into `folder`. SystemExit where it fails."""
    told = list(arguments[: arguments.index("#")] if "#" in arguments else arguments)
    if main([*told, "--out", str(folder)]):
        raise SystemExit(f"docs: failed: {' '.join(arguments)}")


def save(picture: Image.Image, path: Path, width: int | None = None) -> None:
    """As JPEG, not wider than `width` pixels."""
    if width is not None and picture.width > width:
        picture = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.convert("RGB").save(path, quality=_QUALITY, optimize=True, progressive=True)
    print(f"  {path.name}: {picture.width} x {picture.height}, {path.stat().st_size // 1024} KB")

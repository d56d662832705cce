"""Programs that can run a worker: the Python that Blender brings, else Blender itself without a window."""

from __future__ import annotations

import sys
from pathlib import Path

from ...bake.images.image_io import load_openimageio
from ...bake.maps.bake import MapSettings
from ...bake.shading_maps.bake import ArcSettings
from .request import BakeRequest

BOOTSTRAP = Path(__file__).with_name("bootstrap.py")


def hosts(request: BakeRequest, blender: str) -> list[list[str]]:
    """Commands to try one after the other, each of which runs a file of Python; none where nothing is known.

    `blender` is the path of the program, empty where Blender is a module. Photographs that only Blender can decode are
    left to it.
    """
    python = [[program, "-u", str(BOOTSTRAP)] for program in pythons()]
    arguments = ["--background", "--factory-startup", "-noaudio", "--python-exit-code", "9", "--python", str(BOOTSTRAP)]
    application = [[blender, *arguments]] if blender and Path(blender).is_file() else []
    if application and isinstance(request.settings, ArcSettings | MapSettings) and load_openimageio() is None:
        return application
    return python + application


def pythons() -> list[str]:
    """Interpreters like the one that runs here, the likeliest first."""
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    found = [Path(sys.executable)] if sys.executable else []
    for prefix in (sys.prefix, sys.base_prefix):
        names = (f"bin/python{version}", "bin/python3", "bin/python.exe", "python.exe")
        found += [Path(prefix) / name for name in names]
    # Inside old Blenders, and where it is built in another way, this is Blender itself.
    named = [str(path) for path in found if path.name.lower().startswith("python") and path.is_file()]
    return list(dict.fromkeys(named))

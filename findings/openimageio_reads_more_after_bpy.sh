#!/usr/bin/env bash
# What OpenImageIO can read depends on whether bpy was imported: the same library in the same process changes its mind.
#
# Seen with the OpenImageIO 3.0.19.1 inside bpy 4.5.15 (Blender 4.5.15 LTS), numpy 1.26.4.
#
# Blender's wheel brings OpenImageIO's Python module in a folder of its own, which a script may put on its path and
# use without starting Blender. An OpenEXR file of luminance and chroma, the chroma at half the resolution (channels
# Y, RY and BY, a valid kind that OpenEXR describes), is then refused for its subsampled channels. After `import bpy`
# the very same call reads it, as R, G and B.
#
# Why: OpenImageIO has two readers of OpenEXR, chosen by its global attribute openexr:core. Only the older one knows
# luminance-chroma files (github.com/AcademySoftwareFoundation/OpenImageIO, issue 4051 and pull request 4070). The
# newer one is the default here, and Blender sets the attribute to 0 when it starts, for the whole process.
#
# Surprised is whoever tests a reader without Blender and ships it inside, or the other way round: a file is fine in
# one place and "not supported" in the other, with no version or path that differs.
#
# To live with it: set the attribute yourself around what you open, and put it back afterwards; after
# `OpenImageIO.attribute("openexr:core", 0)` such files are read without Blender as well.
#
# Exit status: 0 if both still behave so, 2 if the packages could not be installed, 1 otherwise.
set -euo pipefail

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv" || exit 2
"$folder/venv/bin/pip" install --quiet --no-deps bpy==4.5.15 numpy==1.26.4 || exit 2
export BLENDER_USER_RESOURCES="$folder/user"

"$folder/venv/bin/python" -P - "$folder" <<'PY'
import importlib.util
import struct
import sys
from pathlib import Path

import numpy as np

WIDTH = HEIGHT = 8
LUMINANCE, RED_CHROMA, BLUE_CHROMA = 0.5, 0.25, -0.5
# By definition RY is (R - Y) / Y and BY is (B - Y) / Y, with Y of Rec. 709.
RED, BLUE = LUMINANCE * (1 + RED_CHROMA), LUMINANCE * (1 + BLUE_CHROMA)
GREEN = (LUMINANCE - 0.2126 * RED - 0.0722 * BLUE) / 0.7152


def attribute(name, kind, data):
    return name + b"\0" + kind + b"\0" + struct.pack("<i", len(data)) + data


def channel(name, step):
    half_float = 1
    return name + b"\0" + struct.pack("<4i", half_float, 0, step, step)


def luminance_chroma_file():
    """An even picture, not compressed: rows of BY and RY (every other row, half as wide) and Y."""
    window = struct.pack("<4i", 0, 0, WIDTH - 1, HEIGHT - 1)
    header = struct.pack("<2I", 20000630, 2)
    header += attribute(b"channels", b"chlist", channel(b"BY", 2) + channel(b"RY", 2) + channel(b"Y", 1) + b"\0")
    header += attribute(b"compression", b"compression", b"\0")
    header += attribute(b"dataWindow", b"box2i", window) + attribute(b"displayWindow", b"box2i", window)
    header += attribute(b"lineOrder", b"lineOrder", b"\0")
    header += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    header += attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0))
    header += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
    table, body, start = b"", b"", len(header) + 8 * HEIGHT
    for y in range(HEIGHT):
        values = [BLUE_CHROMA] * (WIDTH // 2) + [RED_CHROMA] * (WIDTH // 2) if y % 2 == 0 else []
        row = np.array(values + [LUMINANCE] * WIDTH, "<f2").tobytes()
        table += struct.pack("<Q", start + len(body))
        body += struct.pack("<2i", y, len(row)) + row
    return header + table + body


def attempt(oiio, path):
    """What the file's centre reads as, or why it does not."""
    source = oiio.ImageInput.open(path)
    if source is None:
        return "refused: " + oiio.geterror().splitlines()[0]
    names = source.spec().channelnames
    pixel = source.read_image("float")[HEIGHT // 2, WIDTH // 2]
    source.close()
    return dict(zip(names, (round(float(value), 3) for value in pixel)))


path = sys.argv[1] + "/luminance_chroma.exr"
Path(path).write_bytes(luminance_chroma_file())
wheel = Path(importlib.util.find_spec("bpy").origin).parent
(inside,) = wheel.glob("*/python/lib/python*/site-packages")
sys.path.append(str(inside))
import OpenImageIO as oiio

print(f"OpenImageIO {oiio.VERSION_STRING} inside bpy 4.5.15, numpy {np.__version__}")
print(f"expected: R {RED:.3f}, G {GREEN:.3f}, B {BLUE:.3f}, or a refusal, and the same one each time")
chosen, seen = [], []
for when in ("before import bpy", "after openexr:core = 0", "after openexr:core = 1", "after import bpy"):
    if "=" in when:
        oiio.attribute("openexr:core", int(when[-1]))
    elif "after" in when:
        import bpy
    chosen.append(oiio.get_int_attribute("openexr:core", -1))
    seen.append(attempt(oiio, path))
    print(f"{when:<22}  openexr:core is {chosen[-1]}; seen: {seen[-1]}")
print(f"Blender {bpy.app.version_string}")

read = [isinstance(answer, dict) for answer in seen]
colours = [[answer[name] for name in "RGB"] for answer in seen if isinstance(answer, dict)]
right = [np.allclose(colour, (RED, GREEN, BLUE), rtol=0, atol=2e-3) for colour in colours]
still = chosen == [1, 0, 1, 0] and read == [False, True, False, True] and all(right)
print("still so: importing bpy changes what OpenImageIO reads" if still else "changed")
sys.exit(0 if still else 1)
PY

#!/usr/bin/env bash
# Blender's Unpack Resources makes one file of two images whose files had the same name in different folders.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4).
#
# Two images, one red and one green, come from red/swatch.png and green/swatch.png and are packed into a .blend. Then
# File > External Data > Unpack Resources writes them beside it, as textures/swatch.png: one file for both. With "Use
# files in current directory", which the menu offers first, the first image writes it and the second takes what it
# finds; with "Write files to current directory", the last one written replaces the others. Either way both images now
# show one colour, the operator reports success, no warning is given, and the packed copies are gone from the session:
# after saving, one picture is lost.
#
# Why: unpacking keeps the base name only, and treats a file that it wrote itself a moment ago like one that was there.
# The manual describes that existing files are used or replaced (docs.blender.org/manual/en/4.5, Files, Packed Data),
# not that images of one .blend meet in this way.
#
# Surprised is whoever has texture sets in a folder each, with albedo.png in all of them, and unpacks a .blend that was
# sent to them packed.
#
# To live with it: give images of one .blend different file names before packing, or unpack to the original location,
# which keeps the folders. Keep the packed .blend until you have looked.
#
# Exit status: 0 if Blender still behaves so, 2 if the packages could not be installed, 1 otherwise.
set -euo pipefail

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv" || exit 2
"$folder/venv/bin/pip" install --quiet --no-deps bpy==4.5.15 numpy==1.26.4 || exit 2
export BLENDER_USER_RESOURCES="$folder/user"

# Blender talks on standard output; what this script says goes by descriptor 3.
"$folder/venv/bin/python" -P - "$folder" 3>&1 >"$folder/log" <<'PY'
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[1])
COLOURS = {"red": (1.0, 0.0, 0.0, 1.0), "green": (0.0, 1.0, 0.0, 1.0)}
say = open(3, "w", buffering=1).write


def write_picture(path, colour):
    image = bpy.data.images.new("picture", 4, 4)
    image.generated_color, image.file_format, image.filepath_raw = colour, "PNG", str(path)
    image.save()
    bpy.data.images.remove(image)


def colour_of(image):
    pixel = tuple(round(value, 2) for value in image.pixels[:4])
    return next((name for name, colour in COLOURS.items() if colour == pixel), str(pixel))


def unpacked(method):
    """What each image shows afterwards, what the operator answered, and the files there are now."""
    project = FOLDER / method
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for name, colour in COLOURS.items():
        path = project / name / "swatch.png"
        path.parent.mkdir(parents=True)
        write_picture(path, colour)
        image = bpy.data.images.load(str(path))
        image.name, image.use_fake_user = name, True
        image.pack()
        path.unlink()
    assert {image.name: colour_of(image) for image in bpy.data.images} == {name: name for name in COLOURS}
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "packed.blend"))
    answer = bpy.ops.file.unpack_all(method=method)
    for image in bpy.data.images:
        image.reload()
    assert not any(image.packed_file for image in bpy.data.images)
    shown = {name: colour_of(bpy.data.images[name]) for name in COLOURS}
    files = sorted(path.relative_to(project).as_posix() for path in project.rglob("*.png"))
    return shown, answer == {"FINISHED"}, files


say(f"Blender {bpy.app.version_string}\n")
say("expected: the red image shows red and the green one green, as before unpacking, or an error\n")
seen = {}
for method in ("USE_LOCAL", "WRITE_LOCAL", "WRITE_ORIGINAL"):
    shown, finished, files = unpacked(method)
    seen[method] = finished, shown["red"], shown["green"], len(files)
    words = "; ".join(f"{name} shows {colour}" for name, colour in shown.items())
    say(f"{method:<14}  seen: {words}; {'no error' if finished else 'an error'}; files: {', '.join(files)}\n")
still = (
    all(seen[method][:1] + seen[method][3:] == (True, 1) for method in ("USE_LOCAL", "WRITE_LOCAL"))
    and all(seen[method][1] == seen[method][2] for method in ("USE_LOCAL", "WRITE_LOCAL"))
    and seen["WRITE_ORIGINAL"] == (True, "red", "green", 2)
)
say("still so: both images are left with one picture\n" if still else "changed\n")
sys.exit(0 if still else 1)
PY

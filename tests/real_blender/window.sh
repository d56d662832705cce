#!/usr/bin/env bash
# window.sh DIR|BLENDER [--only edits|tutorials] [--seeds N ...] [--count N] [--pictures FOLDER]: in a real Blender window
# seeded random edits, undo and redo; then both tutorials by mouse and keys, with a picture of each step.
#
#   BLENDER  the program; Xvfb must be installed beside it, and for the tutorials xdotool and ImageMagick's import
#   DIR      a folder with a whole Linux system and all of these in it, entered by chroot (needs root)
#
# Settings and extensions of whoever calls this are left alone. PYTHON names the interpreter with the bpy wheel.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd -P)"
python="${PYTHON:-$here/../../.venv/bin/python}"
if [ $# -lt 1 ]; then
    sed -n '2,8s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2
    exit 2
fi
if [ ! -e "$1" ]; then
    echo "window: there is no $1" >&2
    exit 2
fi
exec "$python" "$here/window.py" "$@"

#!/usr/bin/env bash
# desk.sh DIR|BLENDER: bakes beside a real Blender window: stalls, ten cancelled bakes, twenty rounds of undo and redo.
#
#   BLENDER  the program; Xvfb must be installed beside it
#   DIR      a folder with a whole Linux system, Blender and Xvfb in it, entered by chroot (needs root)
#
# Settings and extensions of whoever calls this are left alone. PYTHON names the interpreter with the bpy wheel.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd -P)"
python="${PYTHON:-$here/../../.venv/bin/python}"
if [ $# -lt 1 ]; then
    sed -n '2,7s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2
    exit 2
fi
exec "$python" "$here/desk.py" "$@"

#!/usr/bin/env bash
# check.sh DIR|BLENDER: does the extension, built as users get it, work in a real Blender?
#
#   BLENDER  the program
#   DIR      a folder with a whole Linux system and Blender in it, entered by chroot (needs root)
#
# Settings and extensions of whoever calls this are left alone. PYTHON names the interpreter with the bpy wheel.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd -P)"
python="${PYTHON:-$here/../../.venv/bin/python}"
if [ $# -ne 1 ]; then
    sed -n '2,7s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2
    exit 2
fi
if [ ! -e "$1" ]; then
    echo "check: skipped, there is no $1"
    exit 0
fi
exec timeout 2400 "$python" "$here/check.py" "$1"

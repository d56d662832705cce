#!/usr/bin/env bash
# enter.sh DIR SHARE COMMAND...: run a command in the system under DIR, with the folder SHARE as /share there.
set -euo pipefail
if [ "${ENTERED:-}" != yes ]; then # the mounts belong to this process and go with it
    ENTERED=yes exec unshare --mount --propagation private bash "${BASH_SOURCE[0]}" "$@"
fi
dir="$1" share="$2"
shift 2
mkdir -p "$dir/share"
mount -t proc proc "$dir/proc"
mount --rbind /dev "$dir/dev"
mount --rbind /sys "$dir/sys"
mount --bind "$share" "$dir/share"
exec chroot "$dir" /usr/bin/env -i HOME=/share/home PATH=/usr/local/bin:/usr/bin:/bin LANG=C.UTF-8 "$@"

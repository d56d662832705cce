"""How much memory this process has taken, and how much the machine has left; 0 where the system does not say."""

from __future__ import annotations

import sys
from pathlib import Path


def peak_bytes() -> int:
    """Memory that this process has taken at most."""
    # The system's account of resources also counts the process that started this one.
    if most := _of("/proc/self/status", "VmHWM"):
        return most
    try:
        import resource
    except ImportError:
        return 0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def resident_bytes() -> int:
    """Memory that this process takes now."""
    return _of("/proc/self/status", "VmRSS")


def free_bytes() -> int:
    """Memory that new processes can take without pushing others out."""
    return _of("/proc/meminfo", "MemAvailable")


def _of(file: str, key: str) -> int:
    """An entry of a table in KiB, as Linux writes them, in bytes."""
    try:
        for line in Path(file).read_text().splitlines():
            name, _, words = line.partition(":")
            if name == key:
                return int(words.split()[0]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return 0

"""What a report was measured on: speed means nothing without it."""

from __future__ import annotations

import os
import platform

import numpy as np

from .. import VERSION
from ..source import Facts


def machine_facts() -> Facts:
    """Processor, versions; JSON-ready."""
    return {
        "measured_materials": VERSION,
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _processor() -> str:
    """Linux keeps the name out of `platform`."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as stream:
            for line in stream:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()

"""Progress shown at the mouse pointer while an operator keeps Blender busy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

from ...bake.brdf.settings import BakeSettings
from ...bake.maps.bake import MapSettings
from ...bake.shading_maps.bake import ArcSettings
from ..summary.bake_stages import bake_stages, share_done


@contextmanager
def window_progress(
    context: bpy.types.Context, settings: BakeSettings | ArcSettings | MapSettings, jobs: int = 1
) -> Iterator[Callable[[int], Callable[[str, float], None]]]:
    """Give a function from a job's number, counted from 0, to its progress callback (stage, share)."""
    stages, manager = bake_stages(settings), context.window_manager

    def of_job(number: int) -> Callable[[str, float], None]:
        return lambda stage, share: manager.progress_update(
            int(100 * (number + share_done(stages, stage, share)) / jobs)
        )

    manager.progress_begin(0, 100)
    try:
        yield of_job
    finally:
        manager.progress_end()

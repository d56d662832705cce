"""Rules of the scene check: the camera's lens as a source of even numbers, and how many samples suit it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from ...bake.errors import BakeError
from ...nodes.lens_group import LENS_KEY
from ..rendering.quiet_camera import FLAT, even_samples, is_even, is_used, quiet_camera
from .findings import NOTE, Finding, Subject, editable, measured_trees, setting


def no_lens(subject: Subject) -> Iterator[Finding]:
    """Depth of field is off, whose lens materials could draw from."""
    camera = subject.scene.camera
    if camera is None or camera.type != "CAMERA" or camera.data.type not in FLAT or not draws_from_lens(subject):
        return
    if camera.data.dof.use_dof:
        return
    why = "at f/64 nobody sees it, and materials draw from the lens' even numbers: Quiet Camera sets it up"
    mend = editable(camera.data, partial(_quieten, subject))
    yield Finding("quiet_camera", NOTE, f"camera {camera.name}", "Depth of Field is off", "", why, mend)


def uneven_samples(subject: Subject) -> Iterator[Finding]:
    """Cycles' numbers are spread evenly over powers of two."""
    samples = subject.scene.cycles.samples
    if is_even(samples) or not is_used(subject.scene) or not draws_from_lens(subject):
        return
    better = even_samples(samples)
    why = f"numbers of the lens are spread most evenly over powers of two, such as {better}"
    mend = setting(subject.scene.cycles, "samples", better)
    yield Finding("uneven_samples", NOTE, f"scene {subject.scene.name}", f"Max Samples are {samples}", "", why, mend)


def draws_from_lens(subject: Subject) -> bool:
    """Whether any material asks what the camera's lens is; those of versions before do not."""
    return any(LENS_KEY in tree for material in subject.mirrors for tree in measured_trees(material))


def _quieten(subject: Subject) -> None:
    try:
        quiet_camera(subject.scene, subject.shown)
    except BakeError:  # what was found is gone by now
        return


RULES = (no_lens, uneven_samples)

"""A rule of the scene check: how many samples suit the even numbers of the camera's lens."""

from __future__ import annotations

from collections.abc import Iterator

from ...nodes.lens_group import LENS_KEY
from ..rendering.quiet_camera import even_samples, is_even, is_used
from .findings import NOTE, Finding, Subject, measured_trees, setting


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


RULES = (uneven_samples,)

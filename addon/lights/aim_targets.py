"""Whether a scene has something that a mirror can be aimed at, and whether there is any other light."""

from __future__ import annotations

from dataclasses import dataclass

from ...nodes.aimed_light_group import MAX_SLOTS
from ...nodes.light_ray import can_raycast
from .lamp_survey import LampReport

# Irradiance of everything else, over that of the strongest lamp at distance 1.
_HARDLY_ANY = 1e-3


@dataclass(frozen=True)
class Gain:
    """What sampling is worth, and for what, in words.

    Parameters
    ----------
    lamps, world : the noise that is left under either
    time : of a sample
    beside : where the world is sampled, of what becomes of it; begins with a colon
    """

    lamps: str
    world: str
    time: str
    beside: str = ""

    def words(self, *, lamps: bool, world: bool) -> str:
        """Of what there is to sample."""
        told = [noise for noise, there in ((self.lamps, lamps), (self.world, world)) if there]
        return f"{', '.join(told)}, for {self.time}"


GAIN_OF_BRDF = Gain(
    "about a third of the noise under a lamp",
    "about half of the noise under the world",
    "two to four times the time of a sample",
    ": half the noise of a mirror aimed at it",
)
# Of worlds it was not measured.
GAIN_OF_SWATCH = Gain(
    "about a fifth of the noise under a small lamp", "less noise under the world", "about twice the time of a sample"
)
# One that lets light through, on 5.2.2: `tests/real_blender/lamps_agree.py`, under two lamps and a sky.
GAIN_OF_THROUGH = Gain(
    "about two fifths of the noise under a lamp",
    "less noise under the world",
    "about one and a half times the time of a mirror that is aimed",
)
# `./run bench sheets`, nodes and scripts alike: of an aimed mirror's noise 0.06 under a lamp behind, 0.03 under one
# before and 0.3 under a picture, in 0.8 to 3 times its time.
GAIN_OF_SHEET = Gain(
    "less than a tenth of the noise under a lamp",
    "about a third of the noise under the world",
    "up to three times the time of a mirror that is aimed",
)


@dataclass(frozen=True)
class Sampling:
    """Why a scene's lamps cannot be sampled in the shader without bias, or need not be; empty where that is not so.

    `beside` is what becomes of the world, in words, where it is aimed at or sampled; `gain` what sampling is worth, as
    `Gain.words`.
    """

    impossible: str = ""
    needless: str = ""
    beside: str = ""
    gain: str = ""


UNKNOWN = Sampling("nothing is known of its lamps")


def what_to_aim_at(report: LampReport, most: int = MAX_SLOTS) -> str:
    """Describe what is aimed at and why it pays; empty if there is nothing.

    Parameters
    ----------
    report : `survey_scene`'s for a render
    most : lamps that the material has room for
    """
    if not report.slots and not report.world.aimed:
        return ""
    words = report.words()[0]
    fewer = f"; of the lamps at the {most} that light most, for more there is no room" * (report.slots > most)
    return f"{words[:1].lower()}{words[1:]}{fewer}"


def sampling_of(
    report: LampReport, *, osl: bool = False, scripted: bool = False, gain: Gain = GAIN_OF_BRDF
) -> Sampling:
    """Whether a shader can, and should, sample the scene's lamps itself: one of nodes, whose rays may be `scripted`, or
    of OSL."""
    if not (osl or scripted or can_raycast()):
        return Sampling("nodes cannot ask what a ray meets before Blender 5.1; OSL can, on the CPU")
    if report.inexact:
        return Sampling(report.inexact)
    if not report.world_inexact:
        worth = gain.words(lamps=bool(report.slots), world=True)
        return Sampling(beside=f"the world, sampled in the shader too{gain.beside}", gain=worth)
    if not report.slots:
        return Sampling(needless=f"no lamp that can be sampled, and {report.world_inexact}")
    worth = gain.words(lamps=True, world=False)
    if not report.world.aimed:
        return Sampling(gain=worth)
    if osl:  # whose shader does both
        return Sampling(beside="the world, by the mirror of the rest", gain=worth)
    return Sampling(needless=f"{report.world_inexact}, and aiming at it is worth more")


def lamps_are_alone(report: LampReport) -> bool:
    """Whether hardly any light comes from elsewhere: only then does `lamp_share` of a material save more than it costs.

    Under sun and sky it was tried on bronze and plastic: noise up by 12 % and down by 4 %, time up by 10 %.
    """
    if not report.lamps or report.world.aimed:
        return False
    return report.sky <= _HARDLY_ANY * max(lamp.power for lamp in report.lamps)

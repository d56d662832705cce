"""Only the effects a scene calls for: what a material's graph holds, what it omits, and why.

Nothing here touches a node. What is left out changes no picture beyond the bias that is stated with it; a request to
leave out an effect that would be missed is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ...bake.brdf.record import BrdfRecord
from ...bake.envelope.gloss_energy import Rows
from ...bake.errors import BakeError
from ...bake.shading_maps.azimuth.curve_layout import PER_TEXEL
from ...bake.shading_maps.reduced_map import SMALLEST, UNSEEN, detail_layout
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.slice_atlas import SliceLayout
from ...bake.tables.grids.patch_grid import PatchGrid
from ...bake.tables.table import FILTERS, Filter
from ..lights.aim_targets import UNKNOWN, Sampling
from .choices import ALWAYS, AUTO, NEVER, OSL, Choices
from .texel_footprint import Footprint

SAMPLED_EFFECT = "Lamps sampled in the shader"
OSL_EFFECT = "Open Shading Language"
AZIMUTH_EFFECT = "Light from every side"
LEVELS_EFFECT = "Level of detail"
# Of nodes whose rays are scripts.
RAYS = "asked for; it tells the nodes which lamps are seen, and Cycles on the CPU alone renders it"
NO_PASSES = "OSL cannot write them; built of nodes they can be had"
NO_RAYS = "no lamp is sampled, and nodes are as good"
# The first as it is called now; the other in materials that were built before.
MIRROR_EFFECTS = "Mirror part", "Residual by mirror"
# How many texels must become one for it to be worth while.
_WORTHWHILE = 4
# Texels in a pixel, at the farthest point, from which on means by distance are worth their textures.
_FAR = 8.0
# How much larger a table's error may become by a simpler filter.
_AS_GOOD = 1.1


@dataclass(frozen=True)
class Effect:
    """Something a graph may hold: whether it does, why, and what its absence saves or costs, all in words."""

    name: str
    kept: bool
    why: str

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)


THROUGH = Effect("Light through the sheet", True, "a lamp hidden from the camera loses light at flat angles")


@dataclass(frozen=True)
class BrdfPlan:
    """Plan of a tabulated BRDF's graph: what it is to hold, arguments of `nodes.material.build_material`, and the
    account of it; and how much more its closures reflect by gloss, `bake.envelope.gloss_energy.brightened_by_gloss`,
    in front and at the back of a sheet whose sides differ. `osl` is the material as one script, `scripted` one of nodes
    that a script tells which lamps are seen."""

    mode: str
    filter: Filter | None
    residual: bool
    aim: bool
    features: bool
    effects: tuple[Effect, ...]
    sample: bool = False
    osl: bool = False
    normals: bool = False
    brightened: tuple[tuple[float, Rows], ...] = ()
    brightened_behind: tuple[tuple[float, Rows], ...] = ()
    scripted: bool = False


def plan_brdf(
    record: BrdfRecord,
    choices: Choices,
    to_aim_at: str,
    passes: bool = False,
    *,
    ready: bool = False,
    sampling: Sampling = UNKNOWN,
    by_script: Sampling = UNKNOWN,
    normals: bool = False,
) -> BrdfPlan:
    """The least that the mode needs.

    Parameters
    ----------
    record : of a bundle, or of a material's own copy of what it says
    to_aim_at : in words what the scene has to aim at; empty if nothing
    passes : a view layer asks for the denoiser's
    ready : prepared for lights added later
    sampling : whether the shader can sample the scene's lamps
    by_script : whether nodes can that a script tells which are seen; of what is to be OSL and no sheet it goes first
    normals : a view layer shows the Normal pass

    Raises
    ------
    BakeError : the bundle holds not what the mode needs, or a choice would bias the picture
    """
    if choices.mode == "preview":
        account = Effect("Mirror", False, "mode Preview: Cycles' own shaders fitted to the measurement, biased")
        return BrdfPlan("preview", record.table.filter, False, False, False, (account, *_language(choices, False)))
    filter: Filter | None = record.table.filter
    residual = True
    effects: list[Effect] = []
    if choices.mode != "reference":
        effect = plan_residual(record, choices)
        residual = effect.kept
        effects.append(effect)
    aim = sample = scripted = False
    sheet = record.sheet is not None
    if residual:
        if choices.shader == OSL and not sheet and plan_script(choices, by_script):
            sampling, scripted = by_script, True
        sampled = plan_sampling(choices, sampling)
        sample = sampled.kept
        filter, reconstruction = plan_filter(record, choices)
        if not sample:
            aimed = plan_aim(choices, to_aim_at, ready=ready)
            aim = aimed.kept or is_ready(choices, ready)
            effects.append(aimed)
        elif sampling.beside:
            effects.append(Effect("Aimed light", True, sampling.beside))
        effects += [sampled, reconstruction, plan_bounces(choices.mode)]
    osl = residual and choices.shader == OSL and not scripted
    features = passes and residual and not osl and not scripted
    if residual:
        why = "a view layer asks for them" if passes else "no view layer asks for them"
        why = NO_PASSES if passes and (osl or scripted) else why
        effects.append(Effect("Denoiser's passes", features, why))
    marked = normals and residual
    if marked:
        effects.append(Effect("Normal pass", True, "a view layer shows it"))
    if sheet and not sample:
        effects.append(THROUGH)
    if scripted:
        effects.append(Effect(OSL_EFFECT, True, RAYS))
    else:
        effects += _language(choices, residual)
    return BrdfPlan(
        choices.mode, filter, residual, aim, features, tuple(effects), sample, osl, marked, scripted=scripted
    )


def _language(choices: Choices, mirror: bool) -> list[Effect]:
    """Of a material that is to be a script: whether it is, which takes a mirror."""
    if choices.shader != OSL:
        return []
    why = (
        "asked for; Cycles on the CPU alone renders it, by textures that are files of this machine"
        if mirror
        else "Cycles' own shaders alone are as good of nodes"
    )
    return [Effect(OSL_EFFECT, mirror, why)]


def language_of(effects: Sequence[Effect]) -> Effect | None:
    """What became of the wish for Open Shading Language; None where nobody has it."""
    return next((effect for effect in effects if effect.name == OSL_EFFECT), None)


def plan_script(choices: Choices, by_script: Sampling) -> bool:
    """Whether nodes sample as much, and as well, as one script would, once a script tells which lamps are seen.

    Textures stay in the .blend then. Under several lights, or lamps and a world of no picture, one script does more.
    Raises BakeError as `plan_sampling`.
    """
    if by_script.impossible or by_script.needless:
        return False
    return plan_sampling(choices, by_script).kept


def is_ready(choices: Choices, ready: bool) -> bool:
    """Whether a graph that has nothing to aim at is built so that it will aim as soon as there is."""
    return ready and choices.aim == AUTO


def plan_sampling(choices: Choices, sampling: Sampling) -> Effect:
    """Whether the shader samples lamps itself. Raises BakeError where that is asked for and would bias the picture."""
    name = SAMPLED_EFFECT
    if choices.mode == "reference":
        return Effect(name, False, "mode Reference: all of it by the mirror")
    if choices.sample == NEVER:
        return Effect(name, False, "switched off")
    if choices.sample == ALWAYS:
        if sampling.impossible:
            remedy = "leave Sample Lamps to Automatic, which sends a mirror towards them instead"
            raise BakeError("Sample Lamps", f"cannot be had here: {sampling.impossible}", remedy)
        return Effect(name, True, "asked for")
    if choices.aim != AUTO:
        return Effect(name, False, f"Aim at Lights is {choices.aim.capitalize()}")
    if why_not := sampling.impossible or sampling.needless:
        return Effect(name, False, why_not)
    return Effect(name, True, sampling.gain)


def plan_aim(choices: Choices, to_aim_at: str, *, ready: bool = False) -> Effect:
    """Whether to aim, where `to_aim_at` says in words what there is; empty if nothing."""
    name = "Aimed light"
    if choices.aim == ALWAYS:
        return Effect(name, True, to_aim_at or "asked for, though the scene has nothing to aim at yet")
    if choices.aim == NEVER:
        found = f", and this scene has {to_aim_at}: noisier, no bias" if to_aim_at else ""
        return Effect(name, False, f"switched off{found}")
    if to_aim_at:
        return Effect(name, True, to_aim_at)
    later = "; prepared for lights added later, at 10 % more time until Fit to Scene" * is_ready(choices, ready)
    return Effect(name, False, f"nothing to aim at: no lamps, and an even world{later}")


def plan_residual(record: BrdfRecord, choices: Choices) -> Effect:
    """Whether modes "exact" and "balanced" need a mirror beside the native closures. Raises BakeError."""
    name, envelope = MIRROR_EFFECTS[0], record.envelope
    if envelope is None:
        cause = f"mode {choices.mode} needs Cycles' own shaders"
        raise BakeError(record.where, cause, "bake it again with Cycles' Own Shaders")
    parts = record.sheet.parts.values() if record.sheet is not None else ()
    envelopes = [envelope, *(part.envelope for part in parts if part.envelope is not None)]
    rest, worst = (max(found) for found in zip(*(one.rest for one in envelopes), strict=True))
    carried = f"it carries {100 * rest:.2g} % of the light"
    if choices.residual == ALWAYS:
        return Effect(name, True, f"asked for; {carried}")
    if all(one.suffices for one in envelopes):
        return Effect(name, False, f"{carried}; Cycles' own shaders alone are as good")
    if choices.residual == NEVER:
        raise BakeError(
            record.where,
            f"needs its mirror part: {carried}, {100 * worst:.2g} % from some viewers",
            "choose mode Preview, or leave Mirror Part to Automatic",
        )
    return Effect(name, True, carried)


def plan_filter(record: BrdfRecord, choices: Choices) -> tuple[Filter | None, Effect]:
    """The simplest filter whose measured error is about that of the one the table was baked for: of a sheet, in each of
    its tables; None for each as it was baked.

    Raises BakeError where another one was chosen that would misread a table.
    """
    name, tables = "Interpolation", record.tables
    if any(isinstance(table.table.grid, PatchGrid) for table in tables):
        return None, Effect(name, False, "patches of the file, between which there is nothing to blend")
    if choices.filter != AUTO:
        record.check_filter(choices.filter, choices.mode)
        return choices.filter, Effect(name, choices.filter != "nearest", f"{choices.filter}, as asked for")
    baked = list(dict.fromkeys(table.table.filter for table in tables))
    told = " and ".join(baked)
    for simpler in FILTERS[: max(FILTERS.index(one) for one in baked)]:
        if all(_is_as_good(table, simpler) for table in tables):
            why = f"{simpler} instead of {told}: its error is no more than 10 % larger"
            return simpler, Effect(name, False, why)
    if len(baked) > 1:
        return None, Effect(name, True, f"{told}, each side and direction of light as it was baked")
    kept = None if record.sheet is not None else baked[0]
    if record.filter_why:
        return kept, Effect(name, True, record.filter_why)
    if choices.mode == "reference" and any(table.table.spline == "fitted" for table in tables):
        return kept, Effect(name, True, f"{told}, whose fitted coefficients no simpler filter can read")
    simpler = FILTERS[max(FILTERS.index(baked[0]) - 1, 0)]
    ratio = max(_times(table.rms_by_filter, simpler, baked[0]) for table in tables)
    why = f"{told}: the error of {simpler} is {ratio:.2g} times as large" if ratio and simpler != told else told
    return kept, Effect(name, True, why)


def _is_as_good(record: BrdfRecord, name: str) -> bool:
    """Whether a filter serves a table about as well as the one that it was baked for."""
    baked, errors = record.table.filter, record.rms_by_filter
    if name == baked:
        return True
    return baked in errors and errors.get(name, float("inf")) <= _AS_GOOD * errors[baked]


def _times(errors: Mapping[str, float], name: str, baked: str) -> float:
    """A filter's error over that of another; 0 where it is not known."""
    return errors.get(name, 0.0) / max(errors.get(baked, 0.0), 1e-30)


def plan_detail(choices: Choices, model: str, footprint: float, why_unknown: str, where: str) -> tuple[int, Effect]:
    """How many texels of a swatch may become one, and why. Raises BakeError where averaging is forced and would show.

    Parameters
    ----------
    model : of the shading map; only slices can be averaged
    footprint : pixels across the largest texel; infinite where that is not known, for `why_unknown`
    """
    name = "Texels"
    if choices.detail == ALWAYS:
        return 1, Effect(name, True, "asked for at any distance")
    factor = 1
    while footprint * factor * 2 <= UNSEEN and factor < 1 << 14:
        factor *= 2
    if factor < _WORTHWHILE:
        known = f"a texel is up to {footprint:.2g} pixels across" if not why_unknown else why_unknown
        if choices.detail == NEVER:
            raise BakeError(where, f"needs its texels: {known}", "leave the detail to Automatic")
        return 1, Effect(name, True, known)
    if model == "azimuth":
        return 1, Effect(name, True, "a map over azimuth, of which there are means by distance alone")
    if model != "slices":
        why = "has no mean" if model == "power" else "has means by distance alone"
        return 1, Effect(name, True, f"compressed as {model}, which {why}")
    return factor, Effect(name, False, f"{factor} x {factor} as one: seen here they are {footprint:.2g} pixels across")


def plan_levels(choices: Choices, model: str, layout: SliceLayout, tiling: str, footprint: Footprint) -> Effect:
    """Whether rays read means of texels, which are laid out so, where these are finer than a pixel."""
    name = LEVELS_EFFECT
    if choices.detail == ALWAYS:
        return Effect(name, False, "Swatch Detail is Always")
    if model == "power" or tiling != "repeat":
        why = "the power law has no mean" if model == "power" else "only what repeats has means at its border"
        return Effect(name, False, why)
    if detail_layout(layout) is None:
        small = min(layout.height, layout.width) < SMALLEST
        return Effect(name, False, "its texels are few" if small else "the texture would be too large")
    if not footprint.texels:
        return Effect(name, False, footprint.why_unknown or "the camera sees all distances alike")
    most = footprint.texels * footprint.farthest
    if most < _FAR:
        return Effect(name, False, f"a pixel spans {most:.1f} texels at most")
    spans = f"a pixel spans up to {most:.0f} texels" if most < float("inf") else "the camera moves"
    return Effect(name, True, f"{spans}; from 8 on means are read, which take half as many again")


def plan_azimuth(settings: RenderSettings, rank: int) -> Effect:
    """What a map over azimuth takes, and where it does without the light's azimuth."""
    if settings.technique == "lit_texture" or settings.mode == "preview":
        return Effect(AZIMUTH_EFFECT, False, "one picture for all light: lit from all around")
    levels = 3 if settings.lobe is None else 1  # a measured f_r has one of each colour
    curves = levels * -(-rank // PER_TEXEL)
    cost = f"{rank} texels and {curves} of its curves are read for a direction of light"
    around = "; after a diffuse bounce lit from all around" * (settings.mode == "balanced")
    return Effect(AZIMUTH_EFFECT, True, f"shadows turn with the lamps; {cost}{around}")


def plan_bounces(mode: str) -> Effect:
    """Whether light that a diffuse surface has scattered is worth the mirror."""
    name = "Mirror after a diffuse bounce"
    if mode == "balanced":
        return Effect(name, False, "mode Balanced: Preview's shaders there; unseen directly")
    return Effect(name, True, f"mode {mode.capitalize()}")

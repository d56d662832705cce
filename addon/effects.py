"""Only the effects a scene calls for: what a material's graph is to hold, what it does without, and why (DESIGN.md 5).

Nothing here touches a node. What is left out changes no picture beyond the bias that is stated with it; whoever wants
an effect left out that would be missed is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ..bake.bundle import require
from ..bake.errors import BakeError
from ..bake.tables.table import FILTERS

AUTO, ALWAYS, NEVER = "auto", "always", "never"
# Light that may be left out unasked: as much as the envelope's own stated bias.
_NEGLIGIBLE = 1e-3
# Pixels that averaged texels may be across, and how many must become one for it to be worth while.
_UNSEEN = 0.5
_WORTHWHILE = 4
# How much larger a table's error may become by a simpler filter.
_AS_GOOD = 1.1


@dataclass(frozen=True)
class Choices:
    """The artist's.

    Parameters
    ----------
    mode : of `bake.modes.MODES`; a shading map's is with its lighting
    aim, residual, detail : "auto", "always" or "never"
    filter : "auto" or one of `bake.tables.table.FILTERS`
    """

    mode: str = "exact"
    aim: str = AUTO
    residual: str = AUTO
    filter: str = AUTO
    detail: str = AUTO


@dataclass(frozen=True)
class Effect:
    """Something a graph may hold: whether it does, why, and what its absence saves or costs, all in words."""

    name: str
    kept: bool
    why: str

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)


@dataclass(frozen=True)
class BrdfPlan:
    """What a tabulated BRDF's graph is to hold, arguments of `nodes.material.build_material`, and the account of it."""

    mode: str
    filter: str
    residual: bool
    aim: bool
    features: bool
    effects: tuple[Effect, ...]


def plan_brdf(
    facts: Mapping[str, Any],
    choices: Choices,
    where: str,
    to_aim_at: str,
    passes: bool = False,
    *,
    ready: bool = False,
) -> BrdfPlan:
    """The least that the mode needs.

    Parameters
    ----------
    facts : a bundle's
    where : named in errors
    to_aim_at : in words what the scene has to aim at; empty if nothing
    passes : a view layer asks for the denoiser's
    ready : what is not there to aim at may come

    Raises
    ------
    BakeError : the bundle holds not what the mode needs, or a choice would bias the picture
    """
    filter = require(require(facts, "table", dict, where), "filter", str, where, choices=FILTERS)
    if choices.mode == "preview":
        account = Effect("Mirror", False, "mode Preview: native closures fitted to the measurement, biased")
        return BrdfPlan("preview", filter, False, False, False, (account,))
    residual = True
    effects = []
    if choices.mode != "reference":
        if "envelope" not in facts:
            raise BakeError(where, f"mode {choices.mode} needs native closures", "bake it again with Native Closures")
        effect = plan_residual(facts, choices, where)
        residual = effect.kept
        effects.append(effect)
    aim = False
    if residual:
        aimed = plan_aim(choices, to_aim_at, ready=ready)
        filter, reconstruction = plan_filter(facts, choices, where)
        aim = aimed.kept or is_ready(choices, ready)
        effects += [aimed, reconstruction, plan_bounces(choices.mode)]
    features = passes and residual
    if residual:
        why = "a view layer asks for them" if features else "no view layer asks for them"
        effects.append(Effect("Denoiser's passes", features, why))
    return BrdfPlan(choices.mode, filter, residual, aim, features, tuple(effects))


def is_ready(choices: Choices, ready: bool) -> bool:
    """Whether a graph that has nothing to aim at is built so that it will aim as soon as there is."""
    return ready and choices.aim == AUTO


def plan_aim(choices: Choices, to_aim_at: str, *, ready: bool = False) -> Effect:
    """Whether to aim, where `to_aim_at` says in words what there is; empty if nothing."""
    name = "Aimed light"
    if choices.aim == ALWAYS:
        return Effect(name, True, to_aim_at or "asked for, though the scene has nothing to aim at yet")
    if choices.aim == NEVER:
        found = f", and this scene has {to_aim_at}: noisier, no bias" if to_aim_at else ""
        return Effect(name, False, f"not wanted{found}")
    if to_aim_at:
        return Effect(name, True, to_aim_at)
    later = "; ready for lamps to come, which takes 10 % more time until Fit to Scene" * is_ready(choices, ready)
    return Effect(name, False, f"nothing to aim at: no lamps, and an even world{later}")


def plan_residual(facts: Mapping[str, Any], choices: Choices, where: str) -> Effect:
    """Whether modes "exact" and "balanced" need a mirror beside the native closures. Raises BakeError."""
    name = "Residual by mirror"
    envelope = require(facts, "envelope", dict, where)
    rest = 1 - require(envelope, "share", float, where, minimum=0, maximum=1)
    # By viewer too: a residual of the rim only is a small part of all light, and all that is seen there.
    rows = require(envelope, "by_theta_o_deg", list, where, minimum=1)
    worst = max((1 - share for _, share in _pairs(rows, where)), default=rest)
    carried = f"it carries {100 * rest:.2g} % of the light"
    if choices.residual == ALWAYS:
        return Effect(name, True, f"asked for; {carried}")
    if rest <= _NEGLIGIBLE and worst <= 10 * _NEGLIGIBLE:
        return Effect(name, False, f"{carried}; native closures alone are as good")
    if choices.residual == NEVER:
        raise BakeError(
            where,
            f"needs its residual: {carried}, {100 * worst:.2g} % from some viewers",
            "choose mode Preview, or leave the residual to Automatic",
        )
    return Effect(name, True, carried)


def plan_filter(facts: Mapping[str, Any], choices: Choices, where: str) -> tuple[str, Effect]:
    """The simplest filter whose measured error is about that of the one the table was baked for. Raises BakeError."""
    baked = require(require(facts, "table", dict, where), "filter", str, where, choices=FILTERS)
    if choices.filter != AUTO:
        return choices.filter, Effect("Interpolation", choices.filter != "nearest", f"{choices.filter}, as asked for")
    known = facts.get("rms_by_filter")
    errors = {k: v for k, v in known.items() if isinstance(v, float)} if isinstance(known, dict) else {}
    for name in FILTERS[: FILTERS.index(baked)]:
        if baked in errors and errors.get(name, float("inf")) <= _AS_GOOD * errors[baked]:
            why = f"{name} instead of {baked}: its error is no more than 10 % larger"
            return name, Effect("Interpolation", False, why)
    simpler = FILTERS[max(FILTERS.index(baked) - 1, 0)]
    ratio = errors.get(simpler, 0.0) / max(errors.get(baked, 0.0), 1e-30)
    why = f"{baked}: the error of {simpler} is {ratio:.2g} times as large" if ratio and simpler != baked else baked
    return baked, Effect("Interpolation", True, why)


def plan_detail(choices: Choices, model: str, footprint: float, why_unknown: str, where: str) -> tuple[int, Effect]:
    """How many texels of a swatch may become one, and why. Raises BakeError where they are wanted away and would show.

    Parameters
    ----------
    model : of the shading map; only slices can be averaged
    footprint : pixels across the largest texel; infinite where that is not known, for `why_unknown`
    """
    name = "Texels"
    if choices.detail == ALWAYS:
        return 1, Effect(name, True, "asked for at any distance")
    factor = 1
    while footprint * factor * 2 <= _UNSEEN and factor < 1 << 14:
        factor *= 2
    if factor < _WORTHWHILE:
        known = f"a texel is up to {footprint:.2g} pixels across" if not why_unknown else why_unknown
        if choices.detail == NEVER:
            raise BakeError(where, f"needs its texels: {known}", "leave the detail to Automatic")
        return 1, Effect(name, True, known)
    if model != "slices":
        return 1, Effect(name, True, f"compressed as {model}, which has no mean")
    return factor, Effect(name, False, f"{factor} x {factor} as one: seen here they are {footprint:.2g} pixels across")


def plan_bounces(mode: str) -> Effect:
    """Whether light that a diffuse surface has scattered is worth the mirror."""
    name = "Mirror after a diffuse bounce"
    if mode == "balanced":
        return Effect(name, False, "mode Balanced: Preview's closures there; unseen directly")
    return Effect(name, True, f"mode {mode.capitalize()}")


def _pairs(rows: list[Any], where: str) -> list[tuple[float, float]]:
    try:
        return [(float(angle), float(share)) for angle, share in rows]
    except (TypeError, ValueError) as error:
        raise BakeError(where, "'envelope.by_theta_o_deg' does not hold pairs of numbers", "bake it again") from error

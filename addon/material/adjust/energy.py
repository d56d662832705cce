"""Whether an adjusted material reflects, or lets through, more light than it receives, as far as can be known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ....bake.brdf.record import BrdfRecord
from ....bake.errors import BakeError
from ....bake.sampling.gloss import MOST
from ....bake.shading_maps.record import Record
from ....bake.source import LUMINANCE
from ....nodes.adjustments import GLOSS, NEUTRAL
from ....nodes.material_tree import measured_nodes
from ..facts import record_of

# Albedos are integrals over tables, and exact to about this.
_TOLERANCE = 1e-3
# Of what is told as safe: four digits, rounded down.
_DIGITS = 1e4


@dataclass(frozen=True)
class Energy:
    """What leaves an adjusted material at most of the light that arrives from one direction.

    Parameters
    ----------
    largest : directional albedo of the brightest channel seen from where it is largest, of a sheet with what is let
        through; None where that is unknown
    unknown : sockets that are linked, whose values differ from place to place
    safe_brightness : the largest at which no more light leaves than arrives, with the other sockets as they are
    node : whose sockets these are
    through : it lets light through too
    """

    largest: float | None = None
    unknown: tuple[str, ...] = ()
    safe_brightness: float = float("inf")
    node: bpy.types.Node | None = None
    through: bool = False

    @property
    def brightness(self) -> float:
        """That is set; 1 where the material has no socket for it."""
        socket = None if self.node is None else self.node.inputs.get("Brightness")
        return 1.0 if socket is None else float(socket.default_value)

    @property
    def gains(self) -> bool:
        """Whether more light leaves than arrives."""
        return self.largest is not None and self.largest > 1 + _TOLERANCE

    @property
    def mend(self) -> Callable[[], None] | None:
        """Sets the brightness to the largest that is safe; None where too much light is not what is known."""
        return self._lower if self.gains and self.node is not None and "Brightness" in self.node.inputs else None

    def _lower(self) -> None:
        assert self.node is not None
        self.node.inputs["Brightness"].default_value = self.safe_brightness

    @property
    def words(self) -> str:
        """Whole sentences for the artist; empty where all is well."""
        if self.unknown:
            *others, last = self.unknown
            names = f"{', '.join(others)} and {last} are" if others else f"{last} is"
            return f"{names} linked, so whether the material {self.verb} too much light cannot be known"
        if not self.gains:
            return ""
        told = f"The material {self.verb} up to {self.largest:.4g} times the light that it receives"
        return f"{told}. A Brightness of up to {self.safe_brightness:.4g} is safe"

    @property
    def verb(self) -> str:
        """What becomes of the light."""
        return "reflects and lets through" if self.through else "reflects"


def energy_of(material: bpy.types.Material) -> Energy | None:
    """Energy of a measured material by the sockets of its node.

    The directional albedo of the measurement is adjusted as the reflectance is, which is the same, since both are
    linear; of a saturation above 1, where negative values are cut off, it is a lower bound. A gloss above 1 brightens
    native closures, a softer one loses light. Of a sheet, what is reflected and let through is added for either side.
    Of several nodes and sides the worst is told.

    Returns
    -------
    None where nothing is adjusted, the albedo is not known, or the material has no sockets for it.
    """
    try:
        record = record_of(material)
    except BakeError:
        return None
    sides = _sides(record)
    found = [
        energy
        for _, node in measured_nodes(material.node_tree)
        for seen in sides
        if (energy := _energy(node, seen)) is not None
    ]
    return max(found, key=lambda energy: (bool(energy.unknown), energy.largest or 0.0), default=None)


@dataclass(frozen=True)
class _Seen:
    """What a viewer of one side sees.

    Parameters
    ----------
    rows : (p, n, 3) directional albedos as measured: reflection, and of a sheet transmission; a sheet's black are left
        out
    brightened : what a gloss adds to the first, see `RenderingRecord`; diffuse transmission gains nothing
    """

    rows: NDArray[np.float64]
    brightened: Sequence[tuple[float, Sequence[Sequence[float]]]]

    def at(self, gloss: float) -> NDArray[np.float64]:
        """The albedos under a gloss; of a softer one, which loses light, an upper bound."""
        if not self.brightened:
            return self.rows
        glosses = np.array([step for step, _ in self.brightened])
        more = np.array([rows for _, rows in self.brightened], np.float64)
        if more.shape[1:] != self.rows.shape[1:]:
            return self.rows
        flat = more.reshape(len(glosses), -1)
        found = np.reshape([np.interp(gloss, glosses, column) for column in flat.T], self.rows.shape[1:])
        return np.concatenate([self.rows[:1] + found, self.rows[1:]])


def _sides(record: Record) -> list[_Seen]:
    """The front, and of a sheet whose sides differ the back."""
    told = record.rendering
    if not isinstance(record, BrdfRecord):
        return [_Seen(_rows(record, record.through), told.brightened)]
    if record.sheet is None:
        return [_Seen(_rows(record), told.brightened)]
    parts = record.sheet.parts
    front, behind = (record, parts.get("through")), (parts.get("behind"), parts.get("through_behind"))
    back = told.brightened_behind if behind[0] is not None else ()
    seen = [_Seen(_rows(*front), told.brightened)]
    return seen + [_Seen(_rows(*behind), back)] * any(part is not None for part in behind)


def _rows(*parts: Record | None) -> NDArray[np.float64]:
    """Directional albedos (p, n, 3) of the parts that there are."""
    return np.array([part.albedo.directional for part in parts if part is not None], np.float64)


def _energy(node: bpy.types.Node, seen: _Seen) -> Energy | None:
    """By the sockets of one node; None where they are neutral."""
    sockets = {name: node.inputs[name] for name in NEUTRAL if name in node.inputs}
    gloss = sockets.pop(GLOSS, None)
    linked = tuple(name for name, socket in sockets.items() if socket.is_linked)
    rows = seen.at(MOST if gloss is not None and gloss.is_linked else gloss.default_value if gloss is not None else 1.0)
    if gloss is not None and gloss.is_linked and rows.sum(0).max() > max(1.0, seen.rows.sum(0).max()) + _TOLERANCE:
        linked += (GLOSS,)
    through = len(rows) > 1
    if linked:
        return Energy(unknown=linked, through=through)
    values = {name: _value(socket.default_value) for name, socket in sockets.items()}
    unchanged = all(np.allclose(value, _value(NEUTRAL[name])) for name, value in values.items())
    if unchanged and np.allclose(rows, seen.rows):
        return None
    total = saturated(rows, values.get("Saturation", 1.0)).sum(0)
    per_brightness = float(np.max(total * values.get("Tint", 1.0)))
    brightness = float(values.get("Brightness", 1.0))
    safe = np.floor(_DIGITS / per_brightness) / _DIGITS if per_brightness > 0 else float("inf")
    return Energy(per_brightness * brightness, (), float(safe), node, through)


def saturated(reflectance: NDArray[np.float64], saturation: float) -> NDArray[np.float64]:
    """The same as `Adjustments.saturated`, of an array (..., 3)."""
    grey = reflectance @ np.array(LUMINANCE)
    saturation = max(saturation, 0.0)
    return np.maximum(reflectance * saturation + grey[..., None] * (1 - saturation), 0.0)


def _value(value: object) -> NDArray[np.float64]:
    """A number, or a colour without its alpha."""
    return np.array(value, np.float64)[:3] if np.ndim(value) else np.array(value, np.float64)

"""The sides of a sheet from its bundle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..bake.brdf.modes import TABLE_OF
from ..bake.brdf.record import BrdfRecord
from ..bake.source import SheetPart, luminance
from ..bake.tables.table import Filter
from .aimed_light_group import ON_SHEET
from .brdf_group import BrdfParts
from .checked_pixels import check_closures, check_shares
from .data_image import Images, of_part
from .lamp_light_groups import LightTables
from .lamp_share_group import LampShares
from .sheet_group import SheetSide, sheet_group
from .table_groups import table_groups
from .weighted_closures import WeightedClosures


@dataclass(frozen=True)
class SheetBuild:
    """How a sheet's group is built; the parameters are those of `nodes.material.build_material`.

    Parameters
    ----------
    residual : whether parts get a mirror, of which those do whose native closures leave something
    lights : tables of the lamps and the world that the shader is to sample; None where it is not
    """

    mode: str
    filter: Filter | None
    stochastic: bool
    residual: bool
    lamps: bpy.types.Image | None
    lamp_share: bool = False
    lights: LightTables | None = None

    def group(self, record: BrdfRecord, name: str, images: Images, *, normals: bool) -> bpy.types.ShaderNodeTree:
        """The group. Raises BakeError where a part does not hold what the mode needs."""
        assert record.sheet is not None
        front = self._side(record, record.part("through"), name, images, ("", "through"))
        back = None
        if not record.sheet.alike:
            behind = record.part("behind"), record.part("through_behind")
            back = self._side(*behind, name, images, ("behind", "through_behind"))
            # What it takes to ask how wide lamps are is what four mirrors have not left on Cycles' stack.
            front, back = (
                replace(side, reflected=_not_concentrated(side.reflected), through=_not_concentrated(side.through))
                for side in (front, back)
            )
        return sheet_group(
            f"Measured {name}",
            self.mode,
            front,
            back,
            anisotropic=record.anisotropic,
            normals=normals,
            lights=self.lights,
        )

    def _side(
        self,
        reflected: BrdfRecord | None,
        through: BrdfRecord | None,
        name: str,
        images: Images,
        parts: tuple[SheetPart | str, SheetPart],
    ) -> SheetSide:
        """What is seen of one side."""
        both = tuple(0.0 if record is None else white_sky(record) for record in (reflected, through))
        # A front that reflects nothing has a record all the same.
        made = [
            self._parts(record, f"{name} {part}".strip(), of_part(images, part), through=through)
            if record and light
            else None
            for record, light, part, through in zip((reflected, through), both, parts, (False, True), strict=True)
        ]
        if made[1] is not None:
            made[1] = _through(made[1])
        lamps = self.lamps if self.lamp_share else None
        return SheetSide(made[0], made[1], both[0] / max(sum(both), 1e-9), lamps)

    def _parts(self, record: BrdfRecord, name: str, images: Images, *, through: bool) -> BrdfParts:
        table = None
        if self.mode == "reference" or (self.mode != "preview" and self.residual and needs_mirror(record)):
            part = TABLE_OF[self.mode]
            chosen = self.stochastic and part == "table"
            aimed = self.lamps is not None
            table = table_groups(record.baked(part), name, images, self.filter, chosen, aimed=aimed)
            table = replace(table, most_lamps=ON_SHEET)
        envelope = closures_of(record, "envelope", images) if self.mode in ("exact", "balanced") else None
        preview = closures_of(record, "preview_weights", images)
        lamps = self.lamps if table is not None else None
        shares = None
        # Of bundles of before, the front alone has them.
        if self.lamp_share and lamps is not None and envelope is not None and record.has("residual_share"):
            check_shares(record)
            shares = LampShares(images("residual_share"), record.share_layout, through)
        return BrdfParts(table, envelope, preview, lamps, shares, anisotropic=record.anisotropic)


def needs_mirror(record: BrdfRecord) -> bool:
    """Whether native closures leave something of a part, in modes "exact" and "balanced"."""
    return record.envelope is None or not record.envelope.suffices


def white_sky(record: BrdfRecord) -> float:
    """Luminance of what a part shows of an even light, averaged over the viewers."""
    return float(luminance(np.array(record.albedo.white_sky)))


def _not_concentrated(parts: BrdfParts | None) -> BrdfParts | None:
    if parts is None or parts.table is None:
        return parts
    return replace(parts, table=replace(parts.table, concentration=0.0))


def _through(parts: BrdfParts) -> BrdfParts:
    """The same for light from the far side."""
    return replace(
        parts,
        table=None if parts.table is None else replace(parts.table, through=True),
        envelope=None if parts.envelope is None else replace(parts.envelope, through=True),
        preview=None if parts.preview is None else replace(parts.preview, through=True),
    )


def closures_of(record: BrdfRecord, part: str, images: Images) -> WeightedClosures:
    """The "envelope" or the "preview_weights" of a bundle, checked before Blender loads it. Raises BakeError."""
    check_closures(record, part)
    described = record.envelope if part == "envelope" else record.preview
    assert described is not None
    return WeightedClosures(described.closures, images(part), described.viewers)

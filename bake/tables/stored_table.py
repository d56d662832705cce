"""A table as it comes back from its file, whatever the storage, and what a bundle has to say of that."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..bundle.bundle import StoredImage
from ..images.storage import Storage, as_stored, offset_for, raised, scale_for
from ..source import Array, BrdfSource, Facts
from .accuracy import DirectionPairs
from .atlas import pack
from .code_fit import can_be_fitted, fitted_values
from .log_codes import MOST_PEAK, LogCodes, fit_codes
from .padding import pad_slices
from .table import Filter, Table

# Coefficients of a B-spline exceed the values at a peak. (1.3 errs up to 6 % less than 1, 4 up to 7 % more.)
_HEADROOM = 1.3


@dataclass(frozen=True)
class StoredTable:
    """A table of the values that come back, the storage, and what they were multiplied by in the file."""

    table: Table
    storage: Storage
    scale: float = 1.0

    def image(self) -> StoredImage:
        """Image of the table's atlas."""
        atlas = pack(self.table.grid, self.table.values)
        texels = raised(atlas, self.scale, self.storage) if self.table.log is None else self.table.log.encode(atlas)
        return StoredImage(texels, self.storage.image)

    def facts(self) -> Facts:
        """JSON-ready: how values come back from texels."""
        log = {} if self.table.log is None else {"log": self.table.log.facts()}
        return {"scale": self.scale, "offset": offset_for(self.storage), **log}


def store_table(
    table: Table, storage: Storage, pairs: DirectionPairs, truth: Array, source: BrdfSource | None = None
) -> StoredTable:
    """The table as it comes back.

    Parameters
    ----------
    source : what was tabulated, for the codes of storage "log" to be closest to it, and not only its samples at their
        nodes; without it they are those of the samples
    pairs, truth : what the codes of storage "log" are fitted for, truth (P, 3) the BRDF that was tabulated

    Raises ValueError or BakeError for values that the storage cannot hold.
    """
    # What continues the values beyond poles may exceed every sample.
    padded = pad_slices(table.grid, table.values)
    if storage is not Storage.LOG:
        scale = scale_for(padded, storage)
        return StoredTable(replace(table, values=as_stored(table.values, scale, storage)), storage, scale)
    light = truth * pairs.cosines

    def errors_of(kept: Table) -> Array:
        found = kept.evaluate(pairs.wi, pairs.wo) * pairs.cosines
        # The RMS alone is of highlights: on chrome it would leave a tenth of the energy, all that is dark, in code 0.
        # Roots are about what a display shows.
        shown = pairs.weight @ np.abs(np.sqrt(found) - np.sqrt(light))
        errors: Array = np.sqrt(pairs.weight @ (found - light) ** 2) * shown
        return errors

    def channel_errors(codes: LogCodes, filter: Filter = table.filter) -> Array:
        # Of values as they are, for these come to the same codes as rounded ones: the table is decoded once, not at
        # every trial.
        return errors_of(replace(table, log=codes, filter=filter))

    peaks = padded.reshape(-1, 3).max(0).astype(np.float64)
    if source is None or not can_be_fitted(table):
        return StoredTable(with_codes(table, fit_codes(peaks, channel_errors)), storage)
    # Of samples a B-spline errs by smoothing, whatever the range: it takes the one that serves straight lines.
    codes = fit_codes(peaks, lambda codes: channel_errors(codes, "trilinear"))
    if table.filter == "bspline":
        codes = LogCodes.reaching(np.minimum(peaks * _HEADROOM, MOST_PEAK), np.array(codes.ranges))
    sampled = with_codes(table, codes)
    fitted = with_codes(replace(table, values=fitted_values(source, table, codes)), codes)
    return StoredTable(min((sampled, fitted), key=lambda kept: float(errors_of(kept).sum())), storage)


def with_codes(table: Table, codes: LogCodes) -> Table:
    """The table as it comes back from these codes."""
    return replace(table, values=codes.rounded(table.values), log=codes)

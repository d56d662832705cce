"""What a mode and a filter will cost, and how far they are from the measurement, before anything is rendered."""

from __future__ import annotations

from ...bake.brdf.record import BrdfRecord

# Processor time of a camera sample, Principled BSDF = 1: median over 12 materials in 4 lightings
# (`./run bench engine`), and of the filters beside trilinear (`./run bench speed`).
MODE_TIME = {"preview": 1.0, "balanced": 1.5, "exact": 1.5, "reference": 2.0}
# Of modes that sample lamps in the shader, in the same bench as OSL; of nodes on 5.2 about as much.
SAMPLED_TIME = 3.8
FILTER_TIME = {"nearest": 0.98, "trilinear": 1.0, "bspline": 1.1}


def expectation(record: BrdfRecord, mode: str, filter: str, *, sampled: bool = False) -> str:
    """Time and error of a measured BRDF's material in words; without the error where the bundle does not state it.

    Parameters
    ----------
    record : the bundle's, or of what a material keeps of it
    mode : of `bake.brdf.modes.MODES`
    filter : of `bake.tables.table.FILTERS`
    sampled : the shader samples lamps itself
    """
    traced = mode != "preview"
    factor = (SAMPLED_TIME if sampled else MODE_TIME.get(mode, 1.0)) * (FILTER_TIME.get(filter, 1.0) if traced else 1.0)
    many = f"{factor:.1f}"
    words = f"About {'' if many == '1.0' else f'{many} times '}the render time of a Principled BSDF"
    error = _error(record, mode, filter)
    if error is None:
        return words
    return f"{words}; error {100 * error:.2g} % of the reflected light"


def _error(record: BrdfRecord, mode: str, filter: str) -> float | None:
    """Energy-relative error that the bake measured for this mode, scaled to the filter by its RMS.

    None of a filter that was not measured.
    """
    if mode == "preview":
        return record.preview.error if record.preview else None
    if mode != "reference":
        errors = record.residual.errors if record.residual else None
        return errors.relative if errors else None
    baked, other = (record.rms_by_filter.get(name) for name in (record.table.filter, filter))
    if baked and other is None and filter != record.table.filter:
        return None
    return record.errors.relative * (other / baked if baked and other is not None else 1.0)

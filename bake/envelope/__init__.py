"""Envelopes: native Cycles closures under a measured BRDF, and what they leave."""

from .closures import BASIS, closure_values
from .fit import EnvelopeSettings, fit_envelope
from .fitted import ClosureFit, EnvelopeFit, PreviewFit
from .lamp_share import (
    ShareLayout,
    SlopeShareLayout,
    checked_shares,
    lamp_shares,
    part_of_light,
    share_coordinates,
)
from .preview import fit_preview, preview_error
from .residual import ResidualSource, reconstruction_errors
from .texture import (
    fit_from_image,
    guarded_share,
    mirror_probability,
    pack_weights,
    preview_from_image,
    texture_coordinate,
    unpack_weights,
)
from .viewers import Elevations, ViewerGrid

__all__ = [
    "BASIS",
    "ClosureFit",
    "Elevations",
    "EnvelopeFit",
    "EnvelopeSettings",
    "PreviewFit",
    "ResidualSource",
    "ShareLayout",
    "SlopeShareLayout",
    "ViewerGrid",
    "checked_shares",
    "closure_values",
    "fit_envelope",
    "fit_from_image",
    "fit_preview",
    "guarded_share",
    "lamp_shares",
    "mirror_probability",
    "pack_weights",
    "part_of_light",
    "preview_error",
    "preview_from_image",
    "reconstruction_errors",
    "share_coordinates",
    "texture_coordinate",
    "unpack_weights",
]

"""Envelopes: native Cycles closures under a measured BRDF, and what they leave (DESIGN.md section 5)."""

from .closures import BASIS, closure_values
from .fit import EnvelopeFit, EnvelopeSettings, fit_envelope
from .lamp_share import (
    ShareLayout,
    checked_shares,
    lamp_shares,
    part_of_light,
    share_coordinates,
)
from .preview import PreviewFit, fit_preview, preview_from_image
from .residual import ResidualSource, reconstruction_errors, residual_source, residual_table
from .texture import fit_from_image, guarded_share, mirror_probability, pack_weights, texture_coordinate, unpack_weights

__all__ = [
    "BASIS",
    "EnvelopeFit",
    "EnvelopeSettings",
    "PreviewFit",
    "ResidualSource",
    "ShareLayout",
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
    "preview_from_image",
    "reconstruction_errors",
    "residual_source",
    "residual_table",
    "share_coordinates",
    "texture_coordinate",
    "unpack_weights",
]

"""Documents as bundles hold them, of either kind and as small as they come, for tests that need no pixels."""

from __future__ import annotations

import json
from typing import Any

from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.shading_maps.shading_map import ANGLE_KNOTS


def image(width: int, height: int, channels: int = 4, storage: str = "float32") -> dict[str, Any]:
    """An entry of "images"."""
    size = {"width": width, "height": height, "channels": channels}
    return {"file": "x.exr", "storage": storage, "sha256": "0" * 64, **size}


ALBEDO = {
    "theta_o_deg": [0, 45],
    "directional": [[0.5, 0.4, 0.3], [0.6, 0.5, 0.4]],
    "white_sky": [0.5, 0.4, 0.3],
    "largest": 0.6,
    "above_one_deg": [],
}
_LOG = {"range": [8.0, 8, 8], "gain": [0.1, 0.1, 0]}
_SIZES = {"n_o": 4, "n_h": 4, "n_phi": 2, "warp_power": 2}
_TABLE = {"filter": "trilinear", "spline": "none", "storage": "half", "scale": 2.0, "offset": 2.0**-14}
_NORMAL = {
    "basis": "normal",
    "n": 8,
    "parameterization": "bezier",
    "alpha_theta": 0.5,
    "alpha_phi": 0.25,
    "horizon_share": 0.02,
}
_FIT = {"share": 0.8, "overshoot": 1e-4, "by_theta_o_deg": [[0, 0.8], [45, 0.8], [80, 0.8]]}
_BOTH = {"errors": {"envelope_and_residual": {"rms": 0.01, "relative": 0.004}}}

BRDF: dict[str, Any] = {
    "schema": 3,
    "kind": "brdf",
    "source": {"name": "felt", "sha256": "1" * 64, "facts": {"format": "MERL"}},
    "settings": {
        "resolution": 8,
        "storage": "half",
        "filter": "trilinear",
        "basis": "auto",
        "parameterization": "bezier",
        "alpha": "error",
        "spline": "auto",
        "envelope": True,
        "sampler": _SIZES,
    },
    "table": {**_NORMAL, **_TABLE},
    "search": {
        "by_error": {"alpha_theta": 0.5, "alpha_phi": 0.25},
        "by_intensity": {"alpha_theta": 0.0, "alpha_phi": 1.0},
        "intensity_finds_least_error": False,
        "error_of_intensity_choice": 2.5,
    },
    "choice": {
        "candidates": [
            {"basis": "normal", "parameterization": "bezier", "rms": 0.01},
            {"basis": "half", "parameterization": "fitted", "rms": 0.03},
        ]
    },
    "sampler": _SIZES,
    "errors": {"rms": 0.02, "relative": 0.01, "directions": 27564},
    "rms_by_filter": {"nearest": 0.4, "trilinear": 0.1},
    "color_difference": {"exact": {"median": 0.12, "p95": 0.8}, "table": {"median": 0.2, "p95": 1.5}},
    "albedo": ALBEDO,
    "table_albedo": ALBEDO,
    "envelope": {**_FIT, "nodes": 64, "closures": [{"name": "lambert"}, {"name": "ggx", "alpha": 0.3}]},
    "residual": {"scale": 4.0, "offset": 0.0, "grid": {**_NORMAL, "alpha_theta": 0.0}, **_BOTH},
    "preview": {"nodes": 32, "closures": [{"name": "sheen", "sigma": 0.5}], "error": 0.2},
    "images": {
        "table": image(40, 60, 3, "half"),
        "sampler": image(8, 4),
        "residual": image(40, 60, 3, "half"),
        "residual_sampler": image(8, 4),
        "envelope": image(64, 2),
        "preview_weights": image(32, 1),
        "residual_share": image(128, 16, 3),
    },
}
"""Isotropic, in the normal-vector basis."""

_VIEWERS = {"n_theta": 6, "n_phi": 4, "folded": True}
_BRUSHED = {"name": "ggx", "alpha_x": 0.1, "alpha_y": 0.4}
ANISOTROPIC: dict[str, Any] = {
    **{key: BRDF[key] for key in ("schema", "kind", "source", "errors", "rms_by_filter", "albedo")},
    "settings": {"resolution": 8, "storage": "log", "filter": "bspline", "viewers": [6, 4]},
    "table": {
        "anisotropic": True,
        "basis": "half",
        "shape": [4, 4, 8, 8],
        "width_x": 0.1,
        "width_y": 0.4,
        "folded": True,
        **_TABLE,
        "storage": "log",
        "log": _LOG,
    },
    "search": {
        "trials": 79,
        "chosen": "half",
        "best": {
            "normal bezier": {"basis": "normal", "parameterization": "bezier", "rms": 0.03},
            "half": {"basis": "half", "rms": 0.01},
        },
    },
    "sampler": {"n_theta": 2, "n_phi": 2, "n_x": 4, "n_y": 4, "width_x": 0.05, "width_y": 0.2, "folded": True},
    "envelope": {**_FIT, **_VIEWERS, "closures": [{"name": "lambert"}, _BRUSHED]},
    "residual": {"scale": 4.0, "offset": 0.0, "log": _LOG, **_BOTH},
    "preview": {**_VIEWERS, "closures": [_BRUSHED], "error": 0.2},
    "images": {"table": image(48, 60, 3, "byte"), "sampler": image(16, 4)},
}
"""Anisotropic, in the half-vector basis, of codes."""

SHADING_MAP: dict[str, Any] = {
    "schema": 3,
    "kind": "shading_map",
    "source": {
        "name": "felt",
        "facts": {
            "photographs": 5,
            "lights": {"source": "file names"},
            "decoding": {"used": [{"rule": "srgb", "why": "so it says", "converted": "Display P3"}]},
            "calibration": {"how": "brightest in a card", "by": "card"},
        },
    },
    "warnings": ["a word"],
    "map": {
        "model": "slices",
        "slices": 4,
        "height": 16,
        "width": 20,
        "gutter": 4,
        "scale": 2.0,
        "envelope_scale": 4.0,
        "storage": "half",
        "a_max": 0.25,
        "level_by_cosine": [k / (ANGLE_KNOTS - 1) for k in range(ANGLE_KNOTS)],
        "envelope_energy": 0.75,
        "residual_energy": 0.25,
        "means": [[0.0] * 3, [0.3] * 3, [0.6] * 3, [1.0] * 3],
    },
    "averages": {"before": [0.1, 0.4, 1.0], "after": [0, 0.3, 0.6, 1], "elevations_deg": [10.0, 45, 90]},
    "errors": {
        "storage_rms": 1e-4,
        "signal_rms": 0.5,
        "held_out_relative": 0.05,
        "held_out_rms": 0.02,
        "held_out": [{"rms": 0.02}],
    },
    "tiling": {"method": "offset", "seams": {"before": {"visibility": 3.0}, "after": {"visibility": 1.0}}},
    "lobe_fit": {"lobe": {"name": "ggx", "alpha": 0.5}, "residual": 0.1},
    "render": {
        "lobe": None,
        "sigma": 0.5,
        "above": "clamp",
        "technique": "lookup",
        "mode": "exact",
        "tiling": "repeat",
        "a_max": None,
    },
    "albedo": {**ALBEDO, "sigma": 0.5, "a_max": 0.25},
    "f_r": {"name": "paint", "albedo": 0.4},
    "table": BRDF["table"],
    "sampler": BRDF["sampler"],
    "images": {
        "slices": image(20, 72, 3, "half"),
        "envelope": image(20, 16, 4, "half"),
        "table": BRDF["images"]["table"],
        "sampler": BRDF["images"]["sampler"],
    },
}
"""Slices, with a measured f_r, as a material keeps them."""


def changed(document: dict[str, Any], **parts: Any) -> dict[str, Any]:
    """A copy with these parts replaced, or without those given as None."""
    found: dict[str, Any] = json.loads(json.dumps(document))  # a deep copy would share what is shared here
    for key, value in parts.items():
        found[key] = value
        if value is None:
            del found[key]
    return found


def brdf_record(**parts: Any) -> BrdfRecord:
    """The record of `BRDF`, named "felt" in errors, with these parts replaced or left out."""
    return BrdfRecord.parse(changed(BRDF, **parts), "felt")


def sheet_parts(alike: bool = True, **parts: dict[str, Any]) -> dict[str, Any]:
    """The entries "sheet" and "images" of `BRDF` as a sheet, whose parts of these names are as its front but for what
    is given."""
    told = ("schema", "kind", "source", "settings", "images")
    like_front = {key: value for key, value in BRDF.items() if key not in told}
    images = {f"{name}_{image}": entry for name in parts for image, entry in BRDF["images"].items()}
    sheet = {"alike": alike, **{name: changed(like_front, **given) for name, given in parts.items()}}
    return {"sheet": sheet, "images": {**BRDF["images"], **images}}

"""Neural-BRDF's published networks (Sztrajman et al. 2021), evaluated without the reader that is judged by them."""

from __future__ import annotations

from typing import Any

import numpy as np
from measured_materials.bake.source import Array


def network_values(weights: Any, material: str, wi: Array, wo: Array) -> Array:
    """Values (n, 3) of one material's network at local directions (n, 3): half vector and the light's difference."""
    half = wi + wo
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    theta, phi = np.arccos(half[:, 2]), np.arctan2(half[:, 1], half[:, 0])
    x, y = np.cos(phi) * wi[:, 0] + np.sin(phi) * wi[:, 1], np.cos(phi) * wi[:, 1] - np.sin(phi) * wi[:, 0]
    d = [np.cos(theta) * x - np.sin(theta) * wi[:, 2], y, np.sin(theta) * x + np.cos(theta) * wi[:, 2]]
    value = np.stack([np.sin(theta), 0 * theta, np.cos(theta), *d], -1)
    for number in (1, 2, 3):
        value = value @ weights[f"{material}/fc{number}"] + weights[f"{material}/b{number}"]
        value = np.maximum(value, 0) if number < 3 else np.maximum(np.exp(value) - 1, 0)
    return np.asarray(value)

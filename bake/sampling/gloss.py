"""A measured BRDF made glossier or more matt: what a viewer sees of it is stretched in slopes of the half vector.

The half vector h of two directions has the slopes h_xy / h_z. For a fixed viewer wo the map M_g takes wi to the
direction wi' whose half vector has slopes g times as large; with it the glossier BRDF is

    f_g(wi, wo) cos(theta_i) = f(wi', wo) cos(theta_i') J,   J = |d wi' / d wi|.

That is the distribution of reflected light carried along by the map (the change of variables of any density): seen from
wo as much light is reflected as before, less what is spread to below the horizon, and it never exceeds what arrives if
f does not. What is drawn for f and carried along by the inverse, M_1/g, has the weight that it had. With
d wi = 4 (wo . h) d h (Torrance & Sparrow 1967) and d h = cos^3(theta_h) d slopes,

    J = g^2 cos^3(theta_h') (wo . h') / (cos^3(theta_h) (wo . h)).

The slopes of a microsurface of Beckmann or GGX are stretched the same way by a change of its width (Heitz 2014, section
5.3, "Understanding the masking-shadowing function"): D_(alpha / g)(h) cos^4(theta_h) = g^2 D_alpha(h') cos^4(theta_h').
Near the normal f_g of such a lobe is the lobe of width alpha / g; at grazing angles the two differ, because masking
depends on the width and the map does not know of it.
"""

from __future__ import annotations

from typing import Any

# Within these a change of gloss makes sense: beyond, float32 and the tables have no digits left.
LEAST, MOST = 0.25, 4.0


def stretched(xp: Any, wi: Any, wo: Any, gloss: Any, normal: Any = None) -> tuple[Any, Any]:
    """The direction wi' and J of the module's page: (..., 3) and (...). At a gloss of 1 they are wi and 1 to the bit.

    Parameters
    ----------
    wi, wo : unit vectors in the local frame, or in any frame where its z is `normal`
    gloss : factor of the slopes, > 0; its inverse takes wi' back to wi
    """
    total = wi + wo
    flat = total * xp.vec(1.0, 1.0, 0.0) if normal is None else total - xp.scale(normal, xp.dot(normal, total))
    half = xp.scale(flat, gloss - 1) + total
    facing, square = xp.dot(wo, half), xp.dot(half, half)
    turned = xp.scale(half, xp.divide(facing + facing, square)) - wo
    # wo . h is half the length of wi + wo, from where the square of the latter.
    tilt = xp.divide(gloss * xp.length(total), square)
    spread = xp.maximum(facing + facing, 0.0) * (tilt * tilt)
    change = changes(gloss)
    return xp.where_vector(change, turned, wi), xp.where(change, spread, 1.0)


def changes(gloss: Any) -> Any:
    """Whether a gloss is not 1. What is chosen by that Cycles leaves out where nothing changes."""
    return (gloss < 1) + (gloss > 1)


def held(xp: Any, gloss: Any) -> Any:
    """A gloss held within `LEAST` and `MOST`."""
    return xp.minimum(xp.maximum(gloss, LEAST), MOST)

"""Samplers: draws towards lamps, into worlds and from tables, and how noisy they leave a picture."""

from __future__ import annotations

from .mistake import Mistake

MOMENTS = "tests/test_sampler_moments.py"
EVEN = f"{MOMENTS}::test_draws_towards_a_lamp_are_even_over_it"
OSL_EVEN = f"{MOMENTS}::test_osl_draws_evenly_over_a_lamp"
NOISE = f"{MOMENTS}::test_noise_is_near_the_least_that_cells_allow"
BOUND = f"{MOMENTS}::test_light_that_the_table_does_not_foresee_stays_bounded"

MISTAKES = (
    Mistake(
        "cosine-floor-of-a-thousandth",
        "bake/sampling/cell_sampler.py",
        "COSINE_FLOOR = 0.05",
        "COSINE_FLOOR = 0.001",
        (BOUND,),
        "single samples of light that the table did not foresee are 1000 times the mean: fireflies",
    ),
    Mistake(
        "cosine-floor-of-a-third",
        "bake/sampling/cell_sampler.py",
        "COSINE_FLOOR = 0.05",
        "COSINE_FLOOR = 0.33",
        (BOUND, NOISE),
        "a third of all draws of a glossy material is thrown away",
    ),
    Mistake(
        "cells-without-the-jacobian",
        "bake/sampling/half_vector_cells.py",
        "return cosine * 4 * wo_half",
        "return cosine",
        (NOISE,),
        "cells are drawn by the light of a half vector instead of a direction: more noise at grazing viewers",
    ),
    Mistake(
        "slopes-without-the-jacobian",
        "bake/sampling/slope_cells.py",
        "(hz * hz * hz) * xp.maximum(wo_half, 1e-6)",
        "(hz * hz * hz)",
        ("tests/test_anisotropic_table.py::test_density_integrates_to_one",),
        "brushed materials are too bright or too dark by the viewer's cosine to the half vector",
    ),
    Mistake(
        "cells-by-their-mean",
        "bake/sampling/cell_sampler.py",
        "return np.sqrt(material / count), np.sqrt(matte / count)",
        "return material / count, np.sqrt(matte / count)",
        (NOISE,),
        "cells are drawn by the square of their light: the dim ones hardly ever",
    ),
    Mistake(
        "sun-drawn-in-its-middle",
        "bake/sampling/lamps.py",
        "lean = aim.m * u1 * 0.99999",
        "lean = aim.m * u1 * u1 * 0.99999",
        (EVEN,),
        "draws crowd in a sun's disc: its penumbra is too sharp, its glints too small",
    ),
    Mistake(
        "sun-half-drawn",
        "bake/sampling/lamps.py",
        "lean = aim.m * u1 * 0.99999",
        "lean = aim.m * u1 * 0.5",
        (EVEN,),
        "half of a sun's or sphere's light is lost in mirrors that only aimed draws find",
    ),
    Mistake(
        "disk-drawn-in-its-middle",
        "bake/sampling/lamps.py",
        "radius = xp.sqrt(u1) * 0.5",
        "radius = u1 * 0.5",
        (EVEN,),
        "draws crowd in the middle of a disk lamp, whose density says they are even",
    ),
    Mistake(
        "rectangle-drawn-along-its-diagonal",
        "bake/sampling/lamps.py",
        "radius * sine, u2 - 0.5)",
        "radius * sine, u1 - 0.5)",
        (EVEN,),
        "a square lamp is met along its diagonal only",
    ),
    Mistake(
        "osl-sun-drawn-in-its-middle",
        "nodes/osl/measured_lamps.h",
        "float lean = aim.m * u1 * 0.99999;",
        "float lean = aim.m * u1 * u1 * 0.99999;",
        (OSL_EVEN,),
        "the OSL twin draws other directions than its density says",
    ),
    Mistake(
        "osl-disk-drawn-in-its-middle",
        "nodes/osl/measured_lamps.h",
        "s = 0.5 * sqrt(u1) * cos(angle);",
        "s = 0.5 * u1 * cos(angle);",
        (OSL_EVEN,),
        "the same for disk lamps",
    ),
    Mistake(
        "lamps-edge-expected-dark",
        "bake/sampling/lamps.py",
        "reaches * xp.maximum(leaning, _LEAST_COSINE)",
        "reaches * xp.maximum(leaning, 0.001)",
        (f"{MOMENTS}::test_no_lamp_is_expected_to_bring_far_less_than_it_does",),
        "surfaces that see only a lamp's edge hardly aim at it: fireflies along the terminator",
    ),
    Mistake(
        "world-behind-expected-dark",
        "bake/sampling/world.py",
        "_LEAST = 0.1",
        "_LEAST = 0.0001",
        (f"{MOMENTS}::test_no_world_is_expected_to_bring_far_less_than_it_does",),
        "surfaces lit by the lesser of two windows hardly aim at it",
    ),
    Mistake(
        "world-rows-upside-down",
        "bake/sampling/world.py",
        "z * 0.5 + 0.5",
        "0.5 - z * 0.5",
        ("tests/test_world_sampling.py::test_draws_follow_the_density_and_carry_it",),
        "the density of the sky is that of the ground",
    ),
    Mistake(
        "sphere-density-of-a-disk",
        "bake/sampling/lamps.py",
        "sphere_m = xp.where(ratio < 1.0, ratio / (1 + xp.sqrt(1 - ratio)), 2.0)",
        "sphere_m = xp.where(ratio < 1.0, ratio * 0.5, 2.0)",
        (f"{MOMENTS}::test_draws_towards_a_lamp_are_even_over_it[sphere]",),
        "near bulbs are met in their middle only, at a density that agrees with that",
    ),
    Mistake(
        "aimed-density-of-all-draws",
        "nodes/aimed_light_group.py",
        "expr.divide(density * share, aims), 1 - share",
        "expr.divide(density, aims), 1 - share",
        ("tests/test_aimed_estimator.py::test_estimator_of_nodes",),
        "the density says that every draw is aimed: too dark where few are",
    ),
    Mistake(
        "osl-aimed-density-of-all-draws",
        "nodes/osl/measured_lamps.h",
        "aimed = density * share / aiming;",
        "aimed = density / aiming;",
        ("tests/test_aimed_estimator.py::test_estimator_of_osl",),
        "the same in OSL",
    ),
    Mistake(
        "cone-density-of-both-sides",
        "bake/sampling/lamps.py",
        "in_cone * (1 / (2 * math.pi))",
        "in_cone * (1 / (4 * math.pi))",
        ("tests/test_light_sampling.py::test_density_integrates_to_one",),
        "suns and bulbs are twice as bright in every mirror that aims at them",
    ),
    Mistake(
        "lamp-plane-without-its-cosine",
        "bake/sampling/lamps.py",
        "xp.divide(distance * distance * aim.fourth, xp.maximum(-facing, 1e-12))",
        "distance * distance * aim.fourth",
        ("tests/test_aimed_estimator.py::test_estimator_of_nodes",),
        "area lamps seen from aside are too bright",
    ),
    Mistake(
        "alias-swapped",
        "bake/sampling/cell_sampler.py",
        "chosen = xp.where(keep, cell, alias)",
        "chosen = xp.where(keep, alias, cell)",
        ("tests/test_sampler.py::test_chi_square[rough]",),
        "every material is drawn from the wrong cells",
    ),
)

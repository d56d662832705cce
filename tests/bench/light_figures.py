"""Texts that benches behind, sheets and softbox fill, as of `readme_figures.Stated`."""

from __future__ import annotations

# Bench, text and page.
LIGHT = (
    (
        "softbox",
        "under lamps of edge 0.1, 0.3, 1 and 2.5 at a distance of 2, noise was {0.1, noise, median|1}, "
        "{0.3, noise, median|1}, {1, noise, median|1} and {2.5, noise, median|1} times as large before in the median, "
        "{0.1, noise, most|1}, {0.3, noise, most|1}, {1, noise, most|1} and {2.5, noise, most|1} times at most and "
        "{0.1, noise, least|2}, {0.3, noise, least|2}, {1, noise, least|2} and {2.5, noise, least|2} times at least; "
        "each pixel's in parts of its own brightness {0.1, by pixel, median|2}, {0.3, by pixel, median|2}, "
        "{1, by pixel, median|2} and {2.5, by pixel, median|2} times in the median (`./run bench softbox`)",
        "addon/docs/method.md",
    ),
    (
        "behind",
        "beside a quadrature of their files: the RMS of the difference is {mecho shade, RMS|1%} and "
        "{2011-SA1, RMS|1%} % of the picture's, all of it noise; all light together is off by "
        "{mecho shade, light|1%} and {2011-SA1, light|1%} %. Blended between 24 samples along each angle, "
        "{mecho shade, 24 samples|0%} and {2011-SA1, 24 samples|0%} % of what such a shade lets through would be "
        "error, between 160 samples {mecho shade, 160 samples|0%} and {2011-SA1, 160 samples|0%} %.",
        "addon/docs/sheets.md",
    ),
    (
        "sheets",
        "a cloth with a highlight, sampled by nodes, has {HDR world, sampled, noise|1} times the noise of Diffuse and "
        "Translucent BSDF under a picture of the world, {HDR world, aimed, noise|1} times aimed. Under a lamp of one "
        "metre behind it, where these have {lamp behind, native, noise|2%} %, it has {lamp behind, sampled, noise|0} "
        "times that, with Quiet Camera {lamp behind, sampled, quiet, noise|0} times, aimed "
        "{lamp behind, aimed, noise|0}; under a graded sky, which cannot be sampled, {sky, aimed, noise|0} times. "
        "As the script of *Shade by OSL* it has {HDR world, OSL, noise|1}, {lamp behind, OSL, noise|0}, "
        "{lamp behind, OSL, quiet, noise|0} and {sky, OSL, noise|0} times. A sample takes "
        "{lamp behind, sampled, time|0} times as long as one of the two closures under that lamp, "
        "{HDR world, sampled, time|0} times under the picture and {sky, aimed, time|0} times under the sky, as a "
        "script {lamp behind, OSL, time|0}, {HDR world, OSL, time|0} and {sky, OSL, time|0} times.",
        "addon/docs/sheets.md",
    ),
)

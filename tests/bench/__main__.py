"""`./run bench [NAME] [--quick] [--out DIR]`: time and accuracy, measured on this machine."""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

import record

BENCHES = {
    "speed": "file to bundle; lookups per second; every kind of material beside Principled: time, memory, bake",
    "tables": "RMS and total intensity of identity, uniform and Bezier tables: 70 MERL reconstructions, 12 RGL files",
    "bases": "RMS of both bases and every parameterisation at equal bytes, and the choice",
    "bytes": "error against bytes of every storage's file, and of whole bundles; a plot",
    "within": "tables of logarithms within 2.7 kB and 48 KiB beside published networks, on the RGL files",
    "cost": "error of a paint against table size, for every parameterisation and filter; a plot",
    "sheets": "noise and time of sheets that sample lamps, or aim at them, beside Diffuse and Translucent BSDF",
    "sampling": "variance and bytes of cosine, alias tables and warps, by white noise and Sobol numbers",
    "figures": "figures 3 to 7 of Mallett & Yuksel 2016: intensity, tables, turning light, resolution, filters",
    "gallery": "pictures of the twelve RGL and three Cornell materials",
    "cornell": "error of the Cornell paints on held-out samples",
    "anisotropic": "error against bytes in both bases, a brushed disc under turning light, time beside Principled",
    "denoise": "the denoiser's picture by colour, by Cycles' passes and by the material's own, beside Principled",
    "effects": "the graph fitted to six scenes beside the full one: nodes, time, noise, equality",
    "adjust": "what the sockets of Adjust cost: nodes, room on Cycles' stack, time per sample; set and linked",
    "envelope": "energy that native closures carry of 22 measured materials, by budget and number of closures",
    "engine": "noise and time of all modes beside Principled BSDF, 12 materials in 4 lightings; a plot",
    "softbox": "noise of aimed mirrors under lamps of four sizes, by how narrow their lobes are and not",
    "lens": "noise with and without Quiet Camera, of Principled BSDF and of Exact as OSL, in the scene of engine",
    "arc": "photographs to a shading map; noise at equal time of envelope and residual against mirror alone",
    "compression": "power law by brute force and by Newton's method; a fitted basis; storage; held-out photographs",
    "hard": "numerically hard cases: bound and worst error in numpy, nodes and OSL; unstable formulas and their digits",
    "mitsuba": "error times seconds beside Mitsuba 3 on the RGL files, in two scenes; makes .venv-mitsuba",
    "planted": "mistakes planted into a copy of the sources, and which of them no test sees; their NAMEs may follow",
    "scale": "10, 60 and 240 materials in one scene beside Principled: build, memory, first sample; --before COMMIT",
    "lobes": "cos^n and four cheaper curves (Romanyuk 2007): error, tail, digits, time in numpy, nodes and OSL; a plot",
    "stacks": "photographed stacks: pictures, held-out photographs, energy of the envelope, compression",
    "techniques": "the four techniques of Kautz et al. 2004, figure 6, against rendered true geometry",
    "fig4": "a BTF of 441 photographs and its PCA beside shading maps of 10 and 38 (Kautz et al. 2004, figure 4)",
    "parallax": "maps looked up where a viewer sees the relief, beside oblique views of the gantry's swatches",
    "azimuth": "maps over azimuth on real stacks, lights left out, beside PTM, harmonics and RBF of the same bytes",
    "behind": "Klems fabrics lit from behind beside a quadrature of the files by itself: RMS, light, pictures",
    "detail": "a swatch on a plane to the horizon, with and without levels of detail: noise, shimmer, mean; EEVEE",
    "maps": "bake maps beside plain least squares, on renders of known normals and on the gantry's swatches",
    "normals": "what keeps bake maps from the normals of cloth: beside known shadows, none, and white threads",
    "readings": "what each reading of light and viewer predicts of directions that were left out, on the RGL files",
    "formats": "files of every format, written by its layout from a known BRDF and read again",
    "reported": "the report's pictures: Exact beside Preview at 16, 64 and 256 samples, denoised or not",
    "sample-time": "what the time of a sample is made of: parts of Exact taken away one by one, as OSL and as nodes",
    "readme": "figures of README and of pages in addon/docs beside what their benches wrote last",
    "tolerances": "what numeric assertions of the suite allow beside what they need; --quick without Blender",
    "library": "24 materials by one process, by two, and through Dask with a worker killed: time, memory, nothing lost",
    "thousand": "1,000 formulas through Dask, killed and continued: time, overhead, memory; nothing baked twice",
    "faults": "kills, full disks, read-only folders, races, hostile bundles: what is lost, half-written or touched",
    "tileable": "swatches made tileable: seams before and after; sheets of repeats",
}
# Mistakes to plant; archives of UBO2003 to compare in place of the gantry's swatches.
_TAKE_NAMES = ("planted", "fig4")


def main() -> int:
    """Run one bench; without a name, `speed`."""
    listing = "\n".join(f"  {name:12s} {what}" for name, what in BENCHES.items())
    parser = argparse.ArgumentParser(
        prog="./run bench",
        description=__doc__,
        epilog="benches:\n" + listing,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", nargs="?", default="speed", choices=BENCHES, metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="fewer materials, samples or repeats")
    parser.add_argument(
        "--record",
        action="store_true",
        help="keep the figures for the README; with the bench readme, write them into it",
    )
    parser.add_argument("--out", type=Path, default=Path("out") / "bench", help="folder of pictures and tables")
    parser.add_argument("--before", default="", metavar="COMMIT", help="of bench scale: also measure that commit")
    parser.add_argument("parts", nargs="*", metavar="NAME", help="mistakes of bench planted; archives of fig4")
    arguments = parser.parse_intermixed_args()
    if arguments.parts and arguments.name not in _TAKE_NAMES:
        parser.error(f"bench {arguments.name} takes no more names")
    if arguments.parts and arguments.record:
        parser.error("what is recorded is of all: leave out --record, or the names")
    if arguments.before and arguments.name != "scale":
        parser.error(f"bench {arguments.name} takes no --before")
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    if arguments.name == "readme" and arguments.record:
        importlib.import_module("bench_readme").fill(out)
    more = [arguments.parts] if arguments.name in _TAKE_NAMES else [arguments.before] * (arguments.name == "scale")
    status = importlib.import_module(f"bench_{arguments.name.replace('-', '_')}").run(out, arguments.quick, *more)
    seconds, values = time.perf_counter() - started, record.taken()
    print(f"bench {arguments.name}: {seconds:.0f} s; files in {out}")
    if values:
        record.write(out / f"{arguments.name}.json", arguments.name, arguments.quick, seconds, values)
    if arguments.record and values:
        record.write(record.RECORDED / f"{arguments.name}.json", arguments.name, arguments.quick, seconds, values)
        print(f"recorded in {record.RECORDED / arguments.name}.json; ./run bench readme compares the README with it")
    return status or 0


if __name__ == "__main__":
    sys.exit(main())

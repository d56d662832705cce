"""Spoil measurements' files and bundles, and read them: `./run fuzz` by chance, `./run fuzz --guided NAME` by coverage.

By chance, each format in turn is read so many times by several processes, and what became of them is printed: tried,
clean errors, the slowest, memory. UTIA's and MERL's files have few directions. Bundles are spoiled too: documents,
images with checksums made right, and folders with links that lead out. `--record` keeps what was printed, of the most
files of each, and `--table` prints all that is kept. Guided (needs the package atheris, which `./run fuzz --guided`
installs), libFuzzer mutates one format's small file towards code that no file has reached before.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(prog="run fuzz", description=__doc__.splitlines()[0])
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="formats or bundles, or parts of their names (default: all)"
    )
    parser.add_argument("--count", type=int, default=100_000, help="files of each format (%(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="other files with another (%(default)s)")
    parser.add_argument("--guided", action="store_true", help="towards new code, one format, one process")
    parser.add_argument("--record", action="store_true", help="keep what became of them, where it is more than before")
    parser.add_argument("--table", action="store_true", help="only print what was kept of every format")
    options = parser.parse_args()
    import tried

    if options.table:
        print(tried.table())
        return
    if options.guided:
        import guided  # first of all imports of ours: atheris rewrites what it sees being imported

        guided.run(_chosen(options.names, guided.fuzz.NAMES), options.count, options.seed)
        return
    from support import bundle_fuzz, fuzz

    names = _chosen(options.names, (*fuzz.NAMES, *bundle_fuzz.KINDS))
    with fuzz.fast_folder() as folder:
        small = fuzz.small_files(folder) if set(names) & set(fuzz.NAMES) else {}
        small |= {name: bundle_fuzz.small_bundle(name, folder) for name in names if name in bundle_fuzz.KINDS}
        for name in names:
            started = time.perf_counter()
            more = {"one_part": bundle_fuzz.one_part} if name in bundle_fuzz.KINDS else {}
            tally = fuzz.try_in_parts(
                name, small[name], folder, options.count, options.processes, seed=options.seed, **more
            )
            print(f"{name:26s} {tally.told}; {time.perf_counter() - started:.0f} s", flush=True)
            if tally.hangs:
                print(f"{name}: files that hang are kept in {tempfile.gettempdir()}/hang*", flush=True)
            if options.record:
                tried.keep(name, tally)


def _chosen(parts: list[str], names: tuple[str, ...]) -> list[str]:
    wanted = [part.lower() for part in parts]
    found = [name for name in names if name.lower() in wanted]
    # A whole name is that one alone: ALTA is not its stream.
    wanted = [part for part in wanted if part not in {name.lower() for name in found}]
    found += [name for name in names if name not in found and any(part in name.lower() for part in wanted)]
    found = found if parts else list(names)
    if not found:
        sys.exit(f"run fuzz: no format is called {' or '.join(parts)}; there are: {', '.join(names)}")
    return found


if __name__ == "__main__":
    main()

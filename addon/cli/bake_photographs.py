"""Sub-command `bake photographs`, or `bake arc` in older scripts: photographs under a moving lamp to bundles."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import SUFFIX, is_bundle, read_bundle
from ...bake.bundle.origin import Origin, photographs_origin
from ...bake.bundle.result import BakeResult
from ...bake.errors import BakeError
from ...bake.images.storage import IMAGE_STORAGES, Storage
from ...bake.lobes.lobes import Lobe
from ...bake.photographs.photograph import IMAGE_SUFFIXES
from ...bake.shading_maps.against_light import ThroughSettings
from ...bake.shading_maps.azimuth.azimuth_basis import MAX_RANK, MIN_RANK
from ...bake.shading_maps.bake import AZIMUTHS, TILEABLES, ArcSettings, bake_arc
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.store import COMPRESSIONS
from ..photographs.arc_plot import draw_arc
from ..photographs.find_decoder import blender_decoder
from ..plots.figure import need_matplotlib
from ..summary.bake_stages import bake_stages
from ..summary.quality_levels import MAP_LEVELS, by_quality
from ..summary.shading_map_rows import albedo_warning, all_warnings, arc_summary
from .bake_jobs import (
    Bake,
    Job,
    add_quality,
    add_replace,
    add_rights,
    bake_jobs,
    chosen_quality,
    stated_rights,
    usage_error,
)
from .console.photograph_options import add_photographs, numbers, stack_settings
from .console.result import Result, complain
from .lighting_options import add_lighting, known_lobes, lighting, parsed_lobe

_DIFFUSER = ThroughSettings(Path()).diffuser_transmittance


def add_to(kinds: Any) -> None:
    """Add `photographs` to the kinds of `bake`."""
    arc = kinds.add_parser(
        "photographs",
        aliases=["arc"],
        help="photographs of a flat swatch, lit from several elevations",
        description=f"Bake photographs of a flat swatch, taken from straight above with the lamp on an arc of "
        f"elevations or all around, to a shading map NAME{SUFFIX}. Every folder becomes a bundle of its own; "
        "photographs given one by one are one stack.",
    )
    arc.add_argument(
        "sources", nargs="*", type=Path, metavar="FOLDER|FILE", help="folders of photographs, or photographs"
    )
    arc.add_argument("--out", type=Path, default=Path(), metavar="DIR|NAME.mmat", help="where to (default: here)")
    add_replace(arc)
    add_rights(arc)
    add_quality(arc, MAP_LEVELS)
    add_photographs(arc.add_argument_group("photographs"))
    add_azimuths(arc.add_argument_group("light from every side"))
    add_through(arc.add_argument_group("against the light"))
    add_map(arc.add_argument_group("shading map"))
    add_lighting(
        arc.add_argument_group("lighting, which can be changed later without baking"),
        f"base reflection (f_r): {known_lobes()}; auto fits one to the photographs; FILE{SUFFIX} is a baked BRDF "
        "(lambert)",
        f"NAME|auto|FILE{SUFFIX}",
    )
    arc.add_argument(
        "--plot",
        type=Path,
        metavar="FILE.png",
        help="draw the brightness of the photographs against their lights (needs matplotlib)",
    )
    arc.add_argument("--json", action="store_true", help="print the result as JSON")
    arc.set_defaults(run=run, command="bake photographs")


def add_azimuths(group: Any) -> None:
    """Add the options on photographs lit from many sides."""
    usual = ArcSettings()
    group.add_argument(
        "--azimuths",
        choices=AZIMUTHS,
        default=usual.azimuths,
        help="arc: the photographs of one arc, whose shadows stay where they are when the light turns; all: the "
        "shadows turn with it; auto: all, where lights surround the swatch and that predicts photographs left out "
        "better than one arc does; --azimuth, --spread, --sides, --compression, --through and storages other than "
        "half and float32 keep auto to one arc (%(default)s)",
    )
    group.add_argument(
        "--azimuth-rank",
        type=int,
        metavar=f"{MIN_RANK}..{MAX_RANK}",
        help="numbers per texel and channel of a map of light from every side (default: as many as predict "
        "photographs that are left out and keep those that are there)",
    )


def add_through(group: Any) -> None:
    """Add the options on photographs against the light."""
    group.add_argument(
        "--through",
        type=Path,
        metavar="FOLDER",
        help="photographs of the same frame against the light: the lamp on an arc behind the swatch",
    )
    group.add_argument(
        "--through-lights", type=Path, metavar="FILE", help="directions of their lights, as --lights; above or below"
    )
    group.add_argument(
        "--transmittance", type=float, metavar="SHARE", help="of light that the swatch lets through, stated"
    )
    group.add_argument(
        "--diffuser", type=numbers(int, 4), metavar="X,Y,W,H", help="a diffuser in the picture, lit from behind too"
    )
    group.add_argument(
        "--diffuser-transmittance", type=float, metavar="SHARE", help=f"of that diffuser ({_DIFFUSER:g})"
    )


def _through(options: argparse.Namespace) -> ThroughSettings | None:
    """Photographs against the light; raises `argparse.ArgumentTypeError` where only their options are given."""
    told = {
        "--through-lights": options.through_lights,
        "--transmittance": options.transmittance,
        "--diffuser": options.diffuser,
        "--diffuser-transmittance": options.diffuser_transmittance,
        "--transmission": options.transmission,
        "--transmission-sigma": options.transmission_sigma,
    }
    if options.through is None:
        given = next((name for name, value in told.items() if value is not None), "")
        if given:
            raise argparse.ArgumentTypeError(f"{given} is for photographs against the light: give --through FOLDER too")
        return None
    stated = options.diffuser_transmittance
    if stated is not None and options.diffuser is None:
        raise argparse.ArgumentTypeError("--diffuser-transmittance is of a diffuser: give --diffuser X,Y,W,H too")
    return ThroughSettings(
        options.through,
        options.through_lights,
        options.transmittance,
        options.diffuser,
        _DIFFUSER if stated is None else stated,
    )


def add_map(group: Any, storage: str = "--storage") -> None:
    """Add the options on the shading map, that of its texels under the name `storage`."""
    usual = ArcSettings()
    group.add_argument(
        "--slices",
        type=int,
        metavar="N",
        help=f"levels of light, black included ({by_quality(MAP_LEVELS, 'slices')})",
    )
    group.add_argument(
        storage,
        choices=[str(kind) for kind in IMAGE_STORAGES],
        default=str(usual.storage),
        help="of the texels (%(default)s)",
    )
    group.add_argument(
        "--compression",
        choices=COMPRESSIONS,
        default=usual.compression,
        help="power: two numbers per texel and channel (Kautz et al. 2004); basis: RANK numbers (%(default)s)",
    )
    group.add_argument("--rank", type=int, default=usual.rank, metavar="1..3", help="of the basis (%(default)s)")
    group.add_argument(
        "--tileable", choices=TILEABLES, default=usual.tileable, help="make the swatch tile without seams (%(default)s)"
    )


def run(options: argparse.Namespace) -> Result:
    """Bake every stack; a bad one is reported and does not stop the others."""
    settings = settings_of(options)
    jobs = _jobs(options)
    if settings.through is not None and len(jobs) > 1:
        cause = f"--through {options.through} is one swatch's, but there are {len(jobs)} stacks"
        raise argparse.ArgumentTypeError(f"{cause}; bake them one by one")
    if options.plot is not None:
        _check_plot(options.plot, jobs, options.sources)
    warn = partial(_warn, options.slices is not None)
    done, errors = bake_jobs(jobs, options.out, settings, bake_stages(settings), warn, replace=options.replace)
    drawn: list[str] = []
    for result in done if options.plot is not None else []:
        try:
            draw_arc(result.path, options.plot)
            drawn.append(str(options.plot))
        except BakeError as error:
            errors.append(error)
    document: dict[str, Any] = {
        "command": options.command,
        "bundles": [{"path": str(result.path), **result.facts} for result in done],
    }
    if options.plot is not None:
        document["plots"] = drawn
    lines = [arc_summary(_record_of(result), result.seconds) for result in done]
    return Result(document, lines + drawn, errors)


def _warn(slices: bool, job: Job, result: BakeResult) -> None:
    """Tell what is doubtful about a bundle; `slices` were given by their number or not."""
    record = _record_of(result)
    unused = "--slices has no effect on a map over azimuth" if slices and record.map.model == "azimuth" else ""
    for warning in filter(None, [*all_warnings(record), albedo_warning(record), unused]):
        complain(f"warning: {job.title}: {warning}")


def _record_of(result: BakeResult) -> ShadingMapRecord:
    return ShadingMapRecord.read(read_bundle(result.path))


def _check_plot(plot: Path, jobs: Sequence[Job], sources: Sequence[Path]) -> None:
    if plot.suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(f"--plot {plot} is not a FILE.png")
    if _is_photograph(plot) and plot.resolve() in _photographs(sources):
        raise argparse.ArgumentTypeError(f"--plot {plot} is one of the photographs and would be replaced")
    if len(jobs) > 1:
        raise argparse.ArgumentTypeError(f"--plot {plot} names one picture, but there are {len(jobs)} stacks")
    need_matplotlib("--plot")


def _photographs(sources: Sequence[Path]) -> set[Path]:
    inside = [path for source in sources if source.is_dir() for path in source.iterdir()]
    return {path.resolve() for path in (*sources, *inside)}


def settings_of(options: argparse.Namespace) -> ArcSettings:
    """The settings that were asked for. Raises `argparse.ArgumentTypeError`, or BakeError for a wrong statement."""
    auto, lobe, brdf = _lobe(options)
    level = chosen_quality(options, MAP_LEVELS)
    render = lighting(options, RenderSettings(), lobe)
    if brdf is not None:
        render = replace(render, lobe=None)
    try:
        return ArcSettings(
            slices=level["slices"],
            storage=Storage(options.storage),
            compression=options.compression,
            rank=options.rank,
            tileable=options.tileable,
            lobe_auto=auto,
            brdf=brdf,
            render=render,
            rights=stated_rights(options),
            through=_through(options),
            azimuths=options.azimuths,
            azimuth_rank=options.azimuth_rank,
            stack=stack_settings(
                options, level["size"], azimuth=options.azimuth, spread=options.spread, sides=options.sides
            ),
        )
    except BakeError as error:
        raise usage_error(error, options) from None


def _lobe(options: argparse.Namespace) -> tuple[bool, Lobe, Path | None]:
    """(auto, lobe, measured BRDF)."""
    words = options.lobe or ["lambert"]
    bundle = Path(words[0])
    if words[0] != "auto" and bundle.suffix.lower() != SUFFIX:
        return False, parsed_lobe(words, options, f", auto or a FILE{SUFFIX}"), None
    if len(words) > 1:
        raise argparse.ArgumentTypeError(f"--lobe {words[0]} takes no parameters, not {words[1]!r}")
    return words[0] == "auto", Lobe("lambert"), None if words[0] == "auto" else bundle


def _jobs(options: argparse.Namespace) -> list[Job]:
    """A job per folder, or one for all files."""
    if not options.sources:
        raise argparse.ArgumentTypeError("nothing to bake: give a FOLDER of photographs; paths go before --lobe")
    files = [path for path in options.sources if _is_photograph(path)]
    if files and len(files) < len(options.sources):
        other = next(path for path in options.sources if path not in files)
        raise argparse.ArgumentTypeError(
            f"{other} is a folder and {files[0]} is not; give folders or one stack of files"
        )
    if files:
        name = _folder_name(files[0].parent)
        return [Job(name, name, _baker(files), partial(_origin, name, files))]
    named = [(_folder_name(folder), folder) for folder in options.sources]
    return [Job(name, name, _baker(folder), partial(_origin, name, folder)) for name, folder in named]


def _origin(name: str, source: Path | list[Path]) -> Origin:
    return {"name": name, **photographs_origin(source)}


def _is_photograph(path: Path) -> bool:
    try:
        return path.is_file() or (not path.exists() and path.suffix.lower() in IMAGE_SUFFIXES)
    except (OSError, ValueError):  # ValueError: a null character in the path
        return False


def _folder_name(folder: Path) -> str:
    try:
        return folder.resolve().name or "swatch"
    except (OSError, ValueError, RuntimeError):  # RuntimeError: a loop of links
        return folder.name or "swatch"


def _baker(source: Path | list[Path]) -> Bake:
    def bake(target: Path, settings: ArcSettings, progress: Any) -> BakeResult:
        if isinstance(source, Path) and is_bundle(source):
            raise BakeError(source, "is a bundle, baked already", "give the folder of the photographs")
        return bake_arc(source, target, settings, progress, decoder=blender_decoder())

    return bake

"""Sub-command `bake maps`: photographs under lights of many directions to normal, albedo, height and roughness maps."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...bake.errors import BakeError
from ...bake.maps.bake import STAGES, MapSettings, MapsResult, bake_maps
from ...bake.maps.folder import read_maps_folder
from ...bake.maps.relief import check_width
from ...bake.maps.write import FILE_KINDS, NORMAL_CONVENTIONS
from ..photographs.find_decoder import blender_decoder
from ..summary.quality_levels import MAP_LEVELS
from .bake_jobs import add_quality, chosen_quality, made_folder, usage_error
from .console.blend_options import add_blend, check_blend
from .console.photograph_options import add_photographs, stack_settings
from .console.progress import Progress
from .console.result import Result, complain

# What a level sets of photographs that become maps.
_SIZES = {level: {"size": sizes["size"]} for level, sizes in MAP_LEVELS.items()}


def add_to(kinds: Any) -> None:
    """Add `maps` to the kinds of `bake`."""
    usual = MapSettings()
    parser = kinds.add_parser(
        "maps",
        help="photographs lit from many sides, to normal, albedo, height and roughness maps",
        description="Write maps of a flat swatch that was photographed from straight above under eight lights or more, "
        "from all sides: photometric stereo that bears with shadow and gloss. Every folder of photographs becomes a "
        "folder DIR/NAME_maps, with maps.json, which says what each of them holds.",
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="FOLDER", help="folders of photographs")
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where to (default: here)")
    parser.add_argument(
        "--normals",
        choices=NORMAL_CONVENTIONS,
        default=usual.normals,
        help="green points up the picture, as in Blender and glTF, or down it (%(default)s)",
    )
    parser.add_argument(
        "--files",
        choices=FILE_KINDS,
        default=usual.files,
        help="EXR holds linear albedo, heights and F0 as they are (%(default)s)",
    )
    parser.add_argument("--no-level", action="store_true", help="leave the mean slope as it is: the swatch is not flat")
    parser.add_argument("--replace", action="store_true", help="also maps of other photographs under that name")
    parser.add_argument(
        "--reduce",
        type=int,
        default=usual.reduce,
        metavar="N",
        help="N x N texels become one, for a swatch seen from far away: what their normals vary by goes into the "
        "roughness, so that highlights keep their width (%(default)d)",
    )
    parser.add_argument("--repeats", action="store_true", help="the frame goes on at its opposite edge")
    add_quality(parser, _SIZES)
    add_photographs(parser.add_argument_group("photographs"), arc=False)
    add_blend(parser.add_argument_group("as a material of Blender"))
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="bake maps")


def run(options: argparse.Namespace) -> Result:
    """Write the maps of every folder; a bad one is reported and does not stop the others."""
    check_blend(options)
    try:
        check_width(options.width)
        size = chosen_quality(options, _SIZES)["size"]
        settings = MapSettings(
            options.normals,
            options.files,
            not options.no_level,
            options.repeats,
            stack_settings(options, size),
            options.reduce,
        )
    except BakeError as error:
        raise usage_error(error, options) from None
    done: list[MapsResult] = []
    errors: list[BakeError] = []
    with made_folder(options.out), Progress(STAGES, len(options.sources)) as progress:
        for source, target in zip(options.sources, _targets(options), strict=True):
            progress.start(target.name)
            try:
                result = bake_maps(source, target, settings, progress, blender_decoder(), replace=options.replace)
            except BakeError as error:
                errors.append(error)
                continue
            done.append(result)
            progress.close()
            for warning in result.warnings:
                complain(f"warning: {target.name}: {warning}")
    document: dict[str, Any] = {
        "command": options.command,
        "maps": [{"path": str(made.path), **made.facts} for made in done],
    }
    lines = [_line(made) for made in done]
    try:
        if materials := _written_blend(options, [made.path for made in done]):
            document["blend"] = {"file": str(options.blend), "materials": materials}
            lines.append(f"{options.blend}: {', '.join(materials)}")
    except BakeError as error:
        errors.append(error)
    return Result(document, lines, errors)


def _written_blend(options: argparse.Namespace, folders: list[Path]) -> list[str]:
    """Names of the materials that were written of these folders of maps; none where no file is wanted.

    Raises BakeError.
    """
    if options.blend is None or not folders:
        return []
    from ..asset_library.maps_blend import write_maps_blend

    maps = [read_maps_folder(folder) for folder in folders]
    return write_maps_blend(maps, options.blend, relief=options.relief, width=options.width, pack=options.pack)


def _targets(options: argparse.Namespace) -> list[Path]:
    """A folder for each stack. Raises `argparse.ArgumentTypeError` where two would be one."""
    # Not the name alone: beside the photographs that is their own folder.
    names = [f"{source.resolve().name or 'swatch'}_maps" for source in options.sources]
    folded = [name.casefold() for name in names]
    if twice := next((name for name in names if folded.count(name.casefold()) > 1), None):
        raise argparse.ArgumentTypeError(f"two folders would become {options.out / twice}; give them one by one")
    return [options.out / name for name in names]


def _line(made: MapsResult) -> str:
    facts = made.facts
    files = ", ".join([*(str(about["file"]) for about in facts["maps"].values()), str(facts["materialx"])])
    told = f"{len(facts['lights'])} lights, misfit {facts['misfit']:.1%}, gloss told by {facts['gloss_told_share']:.0%}"
    return f"{made.path}: {files} ({told} of the texels, {made.seconds:.1f} s)"

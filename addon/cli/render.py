"""Sub-command `render`: a bundle in the studio, as a picture."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import read_bundle
from ...bake.bundle.origin import mark_of
from ...bake.errors import BakeError
from ...bake.images.png import png_about
from ...bake.maps.folder import read_maps_folder
from ...bake.shading_maps.record import Record, ShadingMapRecord, read_record
from ...bake.shading_maps.render_settings import USUAL_REPEAT, RenderSettings
from ...bake.tables.table import FILTERS
from .console.need_blender import need_blender
from .console.progress import Progress
from .console.result import Result
from .lighting_options import add_lighting, given_lighting, known_lobes, lighting, parsed_lobe

_LARGEST = 16384
_MOST_REPEATS = 1000.0
# Behind the mark of a picture whose linear twin was written too.
_TWIN = " linear"


def add_to(commands: Any) -> None:
    """Add `render`."""
    parser = commands.add_parser(
        "render",
        help="a picture of a bundle in the studio",
        description="Render a bundle in the studio scene with Cycles. Needs Blender or its Python module.",
    )
    parser.add_argument("bundle", type=Path, metavar="BUNDLE", help="a folder NAME.mmat")
    parser.add_argument("--out", type=Path, metavar="FILE.png", help="picture (default: NAME.png here)")
    parser.add_argument("--replace", action="store_true", help="also a file of that name that shows something else")
    parser.add_argument("--exr", action="store_true", help="also FILE.exr, linear Rec.709, 32 bits")
    parser.add_argument("--resolution", type=_positive(_LARGEST), default=480, metavar="PIXELS", help="(%(default)s)")
    parser.add_argument("--samples", type=_positive(1 << 20), default=64, metavar="N", help="(%(default)s)")
    parser.add_argument("--environment", type=Path, metavar="FILE", help="surroundings, an .exr or .hdr image")
    parser.add_argument(
        "--filter", choices=FILTERS, help="of a BRDF's table (default: the one the bundle was baked for)"
    )
    parser.add_argument(
        "--aim",
        choices=("auto", "always", "never"),
        default="auto",
        help="send the mirror towards lamps and bright surroundings, where there are any (%(default)s)",
    )
    parser.add_argument(
        "--sample-lamps",
        choices=("auto", "always", "never"),
        default="auto",
        help="let the shader sample lamps itself, where it can, rather than send a mirror (%(default)s)",
    )
    parser.add_argument(
        "--quiet-camera",
        choices=("auto", "never"),
        default="never",
        help="auto: depth of field that nobody sees, whose lens gives even numbers to draw directions by, at up to "
        "15 %% more time; worth it where mode Reference meets a smooth light, at 64 or 128 samples (%(default)s)",
    )
    parser.add_argument(
        "--denoise",
        choices=("auto", "always", "never"),
        default="auto",
        help="by albedo and normals that the material writes; auto: below 256 samples (%(default)s)",
    )
    parser.add_argument(
        "--osl",
        action="store_true",
        help="with Open Shading Language, on the CPU: a script tells nodes which lamps are seen; where nodes would not "
        "sample any, a BRDF is a script as a whole, and a sheet always",
    )
    _add_shading_map(parser.add_argument_group("shading maps; --mode is for BRDFs too (default: as the bundle says)"))
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="render")


def _add_shading_map(group: Any) -> None:
    add_lighting(group, f"f_r: {known_lobes()}, or measured, where the bundle holds a BRDF")
    group.add_argument(
        "--repeat",
        type=_repeats,
        metavar="N",
        help=f"swatches along a unit of texture coordinates; the ball's circumference has three ({USUAL_REPEAT:g})",
    )
    group.add_argument(
        "--parallax",
        type=Path,
        metavar="MAPS",
        help="show the relief where an oblique view sees it, by the heights of a folder that bake maps wrote of the "
        "same photographs",
    )


def _repeats(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0 < number <= _MOST_REPEATS:
        raise argparse.ArgumentTypeError(f"{text!r} is no number above 0, up to {_MOST_REPEATS:g}")
    return number


def _positive(largest: int) -> Any:
    def parse(text: str) -> int:
        if not text.isdecimal() or not 1 <= int(text) <= largest:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to {largest}")
        return int(text)

    return parse


def run(options: argparse.Namespace) -> Result:
    """Render one bundle. Raises BakeError."""
    bundle = read_bundle(options.bundle)
    record = read_record(bundle)
    settings = _settings(record, options)
    if options.parallax is not None:
        options.parallax = read_maps_folder(options.parallax)
    out = options.out or Path(bundle.path.resolve().stem + ".png")
    if out.suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(f"--out {out} is not a FILE.png; --exr adds a linear .exr beside it")
    mark = mark_of(record.source.entries)
    linear = out.with_suffix(".exr")
    if options.exr and options.environment is not None and linear.resolve() == options.environment.resolve():
        raise BakeError(linear, "is the environment and would be replaced", "give another --out FILE.png")
    earlier = _mark_in(out)
    if not options.replace:
        _keep_others(out, [own for own in (mark, mark + _TWIN) if own == earlier], options)
    if options.exr or earlier == mark + _TWIN:
        mark += _TWIN
    need_blender("render")
    # About 1.5 million samples a second on two cores; only the proportion matters.
    rendering = 0.5 + options.resolution**2 * options.samples / 1.5e6
    with Progress({"building": 2.0, "rendering": rendering, "writing": 0.3}) as progress:
        progress.start(bundle.path.stem)
        linear, denoised, osl = _render(record, settings, options, out, mark, progress)
    mean = linear.mean((0, 1))
    files = [str(out)] + ([str(out.with_suffix(".exr"))] if options.exr else [])
    document = {
        "command": options.command,
        "bundle": str(bundle.path),
        "files": files,
        "resolution": options.resolution,
        "samples": options.samples,
        "mean_linear": [float(value) for value in mean],
        "osl": _is_kept(osl),
        "osl_why": "" if osl is None else osl.why,
        "denoised": denoised.done,
        "denoised_why": denoised.why,
    }
    if settings is not None:
        parallax = None if options.parallax is None else str(options.parallax.path)
        document |= {"render": settings.facts(), "repeat": options.repeat or USUAL_REPEAT, "parallax": parallax}
    without = [] if osl is None or osl.kept else [f"--osl changes nothing: {osl.why}"]
    return Result(document, [*files, *without, denoised.words(options.exr)])


def _mark_in(out: Path) -> str:
    """What an older render left in the file of this name, empty in all others."""
    try:
        return png_about(out) if out.is_file() else ""
    except (OSError, ValueError) as error:
        raise BakeError(out, f"cannot be read ({error})", "choose another place by --out") from error


def _keep_others(out: Path, own: list[str], options: argparse.Namespace) -> None:
    """Raise BakeError where a name that nobody gave is that of a file which no older render of this source has made.

    `own` holds the mark of the picture there if it is such a render.
    """
    linear = out.with_suffix(".exr")
    ours = {out: bool(own), linear: any(mark.endswith(_TWIN) for mark in own)}
    for path in [out] * (options.out is None) + [linear] * options.exr:
        if os.path.lexists(path) and not ours[path]:
            cause = "is there already, is no known render of this source, and is not replaced"
            raise BakeError(path, cause, "give another --out FILE.png, or --replace to replace it")


def _settings(record: Record, options: argparse.Namespace) -> RenderSettings | None:
    """How a shading map is to be lit, None for a BRDF. Options of the other kind are wrong usage."""
    given = given_lighting(options) + [name for name in ("repeat", "parallax") if getattr(options, name) is not None]
    if not isinstance(record, ShadingMapRecord):
        given = [name for name in given if name != "mode"]
        if given:
            raise argparse.ArgumentTypeError(f"--{given[0].replace('_', '-')} is for shading maps, not BRDFs")
        return None
    if options.filter is not None:
        raise argparse.ArgumentTypeError("--filter is for BRDFs, not shading maps")
    for name in ("transmission", "transmission_sigma") if record.through is None else ():
        if name in given:
            option = f"--{name.replace('_', '-')}"
            raise argparse.ArgumentTypeError(f"{option} is for swatches that were photographed against the light too")
    usual = record.render
    lobe = usual.lobe
    if options.lobe == ["measured"]:
        lobe = None
    elif options.lobe is not None:
        lobe = parsed_lobe(options.lobe, options, " or measured")
    return lighting(options, usual, lobe)


def _render(
    record: Record,
    settings: RenderSettings | None,
    options: argparse.Namespace,
    out: Path,
    mark: str,
    progress: Progress,
) -> tuple[Any, Any, Any]:
    """Write the files and return the picture, linear, what was done about its noise, and what became of --osl."""
    import bpy

    from ...bake.images.image_io import write_png
    from ..rendering.contact_sheet import to_display
    from ..rendering.denoising import plan_denoising
    from ..studio.studio import build_studio, remove_studio

    denoised = plan_denoising(options.denoise, options.samples, record)
    progress("building", 0.0)
    material = bpy.data.materials.new(record.files().path.stem)
    try:
        scene = build_studio(
            material,
            resolution=(options.resolution, options.resolution),
            samples=options.samples,
            environment=options.environment,
        )
        try:
            linear, osl = _shown(record, settings, options, (scene, material), denoised, out, progress)
        finally:
            remove_studio(scene)
    finally:
        bpy.data.materials.remove(material)
    progress("writing", 0.0)
    write_png(out, to_display(linear), mark)
    return linear, denoised, osl


def _shown(
    record: Record,
    settings: RenderSettings | None,
    options: argparse.Namespace,
    studio: tuple[Any, Any],
    denoised: Any,
    out: Path,
    progress: Progress,
) -> tuple[Any, Any]:
    """Build the material into the studio, a scene and the material it shows, and render it; with what became of --osl,
    an effect of the material, or None where it was not asked for."""
    from ..material.choices import NEVER
    from ..rendering.denoising import denoise_by_twin, denoise_renders, twin_of
    from ..rendering.quiet_camera import quiet_camera
    from ..studio.studio import render_linear

    scene, material = studio
    exr = out.with_suffix(".exr") if options.exr else None
    say = partial(progress, "rendering")
    build = partial(_build, record, settings, options)
    osl = build(scene, material) if options.osl else None
    if not _is_kept(osl):
        if denoised.done:
            denoise_renders(scene)  # first, for the material then knows of its passes
        build(scene, material)
    if options.quiet_camera != NEVER:
        quiet_camera(scene, [obj for obj in scene.objects if _wears(obj, material)])
    if _is_kept(osl) and denoised.done:
        twin = twin_of(record) if settings is None else _map_twin(record, settings, options)
        return denoise_by_twin(twin, scene, material, render_linear(scene, progress=say), exr), osl
    return render_linear(scene, exr, progress=say), osl


def _is_kept(effect: Any) -> bool:
    return effect is not None and effect.kept


def _build(record: Any, settings: RenderSettings | None, options: argparse.Namespace, scene: Any, material: Any) -> Any:
    """What became of --osl, None where it was not asked for; if a script takes part, the scene is set for it."""
    from ..material.build_brdf import usual_choices
    from ..material.choices import NODES, OSL, Choices
    from ..studio.shown_bundle import build_for

    given = {"aim": options.aim, "sample": options.sample_lamps, "shader": OSL if options.osl else NODES}
    given |= {} if options.filter is None else {"filter": options.filter}
    choices = usual_choices(record, options.mode) if settings is None else Choices()
    osl = build_for(scene, record, material, replace(choices, **given), settings, options.repeat or USUAL_REPEAT)
    _add_parallax(material, record, settings, options)
    return osl


def _add_parallax(material: Any, record: Any, settings: RenderSettings | None, options: argparse.Namespace) -> None:
    """By the maps that were read; once, for a material that is built twice. Raises BakeError."""
    from ..material.adjust.parallax import add_parallax, parallax_node

    if settings is not None and options.parallax is not None and parallax_node(material) is None:
        add_parallax(material, record, options.parallax, tiling=settings.tiling)


def _map_twin(record: ShadingMapRecord, settings: RenderSettings, options: argparse.Namespace) -> Any:
    """A shading map's material that writes the denoiser's passes, whatever lights it."""
    from ...nodes.shading_map_material import build_shading_map
    from ..material.bake_photographs import set_repeat

    twin = build_shading_map(record, settings=settings, features=True)
    set_repeat(twin, options.repeat or USUAL_REPEAT, record.map.layout)
    _add_parallax(twin, record, settings, options)
    return twin


def _wears(obj: Any, material: Any) -> bool:
    return any(slot.material == material for slot in obj.material_slots)

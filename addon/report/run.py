"""The parts of a report, one after the other, on this machine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ...bake.errors import BakeError
from ...bake.lobes.cosine_lobes import COSINE_LOBES
from ...bake.report import maps, tables
from ...bake.report.journal import Journal
from ...bake.report.lobes import lobes_section, measure_lobes
from ...bake.report.machine import machine_facts
from ...bake.report.page import Section, write_page
from ...bake.source import BrdfSource
from . import techniques as report_techniques
from .inputs import Inputs
from .lobe_timing import RenderedLobes, measure_rendered
from .lookups import measure_lookups
from .maps import measure_map_times
from .pictures import FULL as FULL_PICTURES
from .pictures import QUICK as QUICK_PICTURES
from .pictures import measure_pictures, pictures_section
from .render_timing import Effort
from .swatches import Subject, built_in, of_path

_TITLE = "Measured Materials: what accuracy costs"
_KEPT = ".measured"
Say = Callable[[float], None]


@dataclass(frozen=True)
class Sizes:
    """Sizes of a report: how much is measured; seconds are typical of two cores, by which progress is reported."""

    tables: tables.TableSizes
    lookups: tables.TableSizes
    maps: maps.MapSizes
    pictures: Any
    techniques: report_techniques.TechniqueSizes
    swatch: tuple[int, int]  # pixels and samples
    lookup_effort: Effort
    lobe_effort: Effort
    seconds: dict[str, float]


QUICK = Sizes(
    tables.QUICK,
    tables.QUICK_LOOKUPS,
    maps.QUICK,
    QUICK_PICTURES,
    report_techniques.QUICK,
    (64, 12),
    Effort(64, 16, 2),
    Effort(64, 16, 2),
    {
        "lookups": 12,
        "tables": 20,
        "pictures": 25,
        "photographs": 15,
        "maps": 8,
        "samples": 8,
        "techniques": 8,
        "lobes": 10,
    },
)
FULL = Sizes(
    tables.FULL,
    tables.FULL_LOOKUPS,
    maps.FULL,
    FULL_PICTURES,
    report_techniques.FULL,
    (112, 32),
    Effort(80, 12, 2),
    Effort(96, 12, 3),
    {
        "lookups": 90,
        "tables": 210,
        "pictures": 150,
        "photographs": 70,
        "maps": 120,
        "samples": 50,
        "techniques": 20,
        "lobes": 40,
    },
)


@dataclass
class _Made:
    """What is written in the end."""

    sections: list[Section] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def add(self, kind: str, name: str, section: Section, facts: Any) -> None:
        """Append a section of the page and keep its facts under kind and name."""
        self.sections.append(section)
        self.facts.setdefault(kind, {})[name] = facts


def stages(inputs: Inputs, sizes: Sizes) -> dict[str, float]:
    """Typical seconds of each, by the names that `run_report` calls them by."""
    return {name: sizes.seconds[name.split(" ")[0]] for name in _stage_names(inputs)}


def _stage_names(inputs: Inputs) -> Iterator[str]:
    yield from (f"lookups in nodes, {axes} axes" for axes in _axes(inputs))
    for name in inputs.sources:
        yield from (f"tables of {name}", f"pictures of {name}")
    for name in inputs.swatches:
        yield from (f"photographs of {name}", f"maps of {name}", f"samples of {name}", f"techniques for {name}")
    yield "lobes"


def _axes(inputs: Inputs) -> list[str]:
    shapes = {source.isotropic for source in inputs.sources.values()}
    return ["three"] * (True in shapes) + ["four"] * (False in shapes)


def run_report(
    inputs: Inputs, out: Path, sizes: Sizes, progress: Callable[[str, float], None]
) -> tuple[Path, list[Section], dict[str, Any]]:
    """Measure and write; what the same version has measured of the same inputs is taken up. Raises BakeError."""
    machine = machine_facts()
    about = {**machine, "sizes": str(sizes), "inputs": inputs.origin}
    # Each set of inputs and sizes has a folder of its own: a quick run takes nothing from a full one, or other files.
    _check_folder(out)
    folder = out / _KEPT / hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:12]
    journal = Journal(folder / "journal.jsonl", about)
    made = _Made()

    def say(stage: str) -> Say:
        return lambda share: progress(stage, share)

    # First of all, so that a bad one is reported before minutes have gone into the others.
    given = {name: of_path(path, name, sizes.swatch[0]) for name, path in inputs.swatches.items() if path is not None}
    times: dict[tables.LookupKey, float] = {}
    for axes in _axes(inputs):
        words = say(f"lookups in nodes, {axes} axes")
        times |= measure_lookups(journal, sizes.lookups, axes == "four", sizes.lookup_effort, words)
    for name, source in inputs.sources.items():
        _brdf(name, source, folder, journal, sizes, times, say, made)
    for name in inputs.swatches:
        subject = given.get(name) or _built_in(name, folder, sizes, say(f"photographs of {name}"))
        _swatch(subject, journal, sizes, say, made)
    _lobes(journal, sizes, say("lobes"), made)
    said = (
        f"Measured on {machine['processor']}, {machine['cores']} cores, with version {machine['measured_materials']}; "
        "times are of this machine, and scatter by a tenth or more if it is busy. In every chart less is better on "
        "both axes, and both are logarithmic. The dashed line is the Pareto front, the settings that no other beats in "
        "both; the ring marks the one we would pick: where paying more begins to buy little or, of noise that falls "
        "with time, the most accurate. All figures lie beside this page as CSV and JSON."
    )
    path = write_page(out, _TITLE, [said], made.sections, {"machine": machine, **made.facts})
    return path, made.sections, {"machine": machine, **made.facts}


def _check_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BakeError(out, f"cannot be made ({error.strerror})", "choose another folder by --out") from error


def _brdf(
    name: str,
    source: BrdfSource,
    folder: Path,
    journal: Journal,
    sizes: Sizes,
    times: dict[tables.LookupKey, float],
    say: Callable[[str], Say],
    made: _Made,
) -> None:
    found = tables.measure_tables(source, journal, sizes.tables, say(f"tables of {name}")).timed(times)
    made.add("tables", name, tables.tables_section(name, found), [vars(s) for s in found.settings])
    kept = folder / hashlib.sha256(name.encode()).hexdigest()[:12]
    kept.mkdir(parents=True, exist_ok=True)
    rendered, galleries = measure_pictures(source, kept, journal, sizes.pictures, say(f"pictures of {name}"))
    made.add("pictures", name, pictures_section(name, rendered, galleries), [vars(row) for row in rendered])


def _swatch(subject: Subject, journal: Journal, sizes: Sizes, say: Callable[[str], Say], made: _Made) -> None:
    name, images = subject.name, subject.all_images
    found = maps.measure_maps(name, images, journal, sizes.maps, say(f"maps of {name}"))
    times = measure_map_times(name, images, journal, sizes.maps, sizes.lookup_effort, say(f"samples of {name}"))
    found = maps.timed(found, times)
    made.add("maps", name, maps.maps_section(name, found, len(images)), [vars(s) for s in found])
    compared = report_techniques.measure_techniques(subject, journal, sizes.techniques, say(f"techniques for {name}"))
    section = report_techniques.techniques_section(subject, compared)
    made.add("techniques", name, section, {key: compared[key] for key in ("cases", "rendered")})


def _built_in(name: str, folder: Path, sizes: Sizes, say: Say) -> Subject:
    say(0.0)
    return built_in(name, folder / f"{name}.npy", *sizes.swatch, say)


def _lobes(journal: Journal, sizes: Sizes, say: Say, made: _Made) -> None:
    costs = measure_lobes(journal)
    effort = sizes.lobe_effort
    thorough = sizes is FULL
    timed = journal.measure(
        "lobes rendered", partial(_json, lambda: measure_rendered(COSINE_LOBES, effort, say, thorough=thorough))
    )
    made.sections.append(lobes_section(costs, timed["ns"], timed["missing"]))
    made.facts["lobes"] = {
        "numpy": [vars(cost) for cost in costs],
        "rendered": timed["ns"],
        "missing": timed["missing"],
    }


def _json(measure: Callable[[], RenderedLobes]) -> dict[str, Any]:
    return vars(measure())

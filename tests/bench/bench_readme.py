"""Every figure of the README beside what its bench wrote last, in this clone or on record; disagreements are marked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import record
from readme_figures import ROOT, STATED, Stated, holds, looked_up, page_figures, printed, unregistered, words

PAGE = "addon/docs/hard_cases.md"


def run(out: Path, quick: bool) -> None:
    """Print all; what benches left in the folder `out` counts before what is recorded."""
    wrong = missing = 0
    for bench in dict.fromkeys(stated.bench for stated in STATED):
        found = record.read(bench, out) or record.read(bench)
        print(f"\n{_heading(bench, found)}")
        for stated in (one for one in STATED if one.bench == bench):
            for line in compare(stated, found["values"] if found else {}):
                print(f"  {line}")
                wrong += line.startswith("WRONG")
                missing += line.startswith("?")
    found = record.read("hard", out) or record.read("hard")
    print(f"\n{_heading('hard', found)}")
    for line in compare_page(found["values"]) if found else ["? nothing recorded"]:
        print(f"  {line}")
        wrong += line.startswith("WRONG")
        missing += line.startswith("?")
    left = unregistered((ROOT / "README.md").read_text(encoding="utf-8"))
    for text in left:
        print(f"not registered in readme_figures.py: {text}")
    print(f"\n{wrong} wrong, {missing} not recorded, {len(left)} not registered")


def fill(out: Path) -> None:
    """Write what is recorded into README and CHANGELOG, and the page of the last `./run bench hard` into its place."""
    for file in dict.fromkeys(stated.file for stated in STATED):
        text = before = (ROOT / file).read_text(encoding="utf-8")
        for stated in (one for one in STATED if one.file == file):
            if found := record.read(stated.bench):
                try:
                    text = stated.filled(text, found["values"])
                except KeyError as missing:
                    print(f"kept as it is, {stated.bench} recorded no {missing}: {stated.template}")
        if text != before:
            (ROOT / file).write_text(text, encoding="utf-8")
            print(f"wrote {file}")
    page, found = out / "hard_cases.md", record.read("hard")
    if found and page.is_file() and page_figures(page.read_text(encoding="utf-8")) == found["values"]:
        (ROOT / PAGE).write_text(page.read_text(encoding="utf-8"), encoding="utf-8")
        print(f"wrote {PAGE}")


def _heading(bench: str, found: dict[str, Any] | None) -> str:
    if found is None:
        return f"./run bench {bench}: nothing recorded; run it with --record"
    options = " --quick" if found["quick"] else ""
    return f"./run bench {bench}{options}: {found['date']}, commit {found['commit']}, {found['machine']}"


def compare(stated: Stated, values: dict[str, float]) -> list[str]:
    """A line for each figure and claim: "ok", "WRONG" or, where nothing is recorded, "?"."""
    match = stated.pattern().search(words(stated.file))
    if match is None:
        return [f"WRONG {stated.file} has no such text: {stated.template}"]
    lines = []
    for (name, form), shown in zip(stated.fields, match.groups(), strict=True):
        try:
            now = printed(looked_up(values, name), form)
        except KeyError:
            now = None
        mark = "?" if now is None else "ok" if now == shown else "WRONG"
        lines.append(f"{mark:5s} {stated.file} {shown:>7s}, bench {now or '-':>7s}  {name}")
    for claim in stated.claims:
        try:
            mark = "ok" if holds(values, claim) else "WRONG"
        except KeyError:
            mark = "?"
        lines.append(f"{mark:5s} {stated.file} {'':>7s}  {claim}")
    return lines


def compare_page(values: dict[str, float]) -> list[str]:
    """Of the page of hard cases; its text is what `./run bench hard --record` writes."""
    shown = page_figures((ROOT / PAGE).read_text(encoding="utf-8"))
    different = {name for name in shown.keys() | values.keys() if shown.get(name) != values.get(name)}
    lines = [f"WRONG {PAGE} {shown.get(name)}, bench {values.get(name)}  {name}" for name in sorted(different)]
    return lines or [f"ok    {PAGE}: all {len(shown)} numbers"]

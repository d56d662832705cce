"""Plants one mistake at a time, runs the tests that should see it, and says which went unseen."""

from __future__ import annotations

import json
import queue
import re
import signal
import tempfile
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from . import all_mistakes
from .copied_tree import CopiedTree
from .mistake import Mistake

LEAST_RATE = 0.95
_WORKERS = 2
_QUICK = 5  # every so many
_BASELINE_TIMEOUT = 1800.0
_FAILED, _INTERRUPTED = 1, 2  # of pytest
_INTERRUPTED_STATUS = 130  # of this bench


@dataclass(frozen=True)
class Verdict:
    """`outcome` is "caught", "escaped", "stale", or "unusable" where its tests say nothing without the mistake."""

    name: str
    outcome: str
    detail: str
    seconds: float = 0.0


def run(names: Sequence[str], quick: bool, out: Path) -> int:
    """Judge the mistakes named, or all. Returns 0 where enough are caught and the others explained, else 1.

    Parameters
    ----------
    quick : every fifth only
    out : folder of `planted.json`, the verdicts
    """
    mistakes = all_mistakes()
    if unknown := [name for name in names if name not in mistakes]:
        print(f"no mistake is called {unknown[0]!r}; there are: {', '.join(mistakes)}")
        return 1
    chosen = [mistakes[name] for name in names] or list(mistakes.values())[:: _QUICK if quick else 1]
    # The default for SIGTERM would leave the copies behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        trees = [CopiedTree(Path(folder) / str(k)) for k in range(min(_WORKERS, len(chosen)))]
        try:
            verdicts = _judged(trees, chosen)
        except KeyboardInterrupt:
            print("interrupted; the working tree was never touched")
            return _INTERRUPTED_STATUS
        finally:
            for tree in trees:
                tree.stop()
    (out / "planted.json").write_text(json.dumps([asdict(v) for v in verdicts], indent=1) + "\n")
    return _report(chosen, verdicts)


def _judged(trees: list[CopiedTree], chosen: list[Mistake]) -> list[Verdict]:
    _check_control(trees)
    free: queue.Queue[CopiedTree] = queue.Queue()
    for tree in trees:
        free.put(tree)
    said = threading.Lock()

    def with_tree(work: Callable[[CopiedTree], Any]) -> Any:
        tree = free.get()
        try:
            return work(tree)
        finally:
            free.put(tree)

    def judge(mistake: Mistake) -> Verdict:
        verdict = with_tree(lambda tree: _verdict(tree, mistake, baseline))
        with said:
            print(f"{verdict.outcome:9s} {verdict.name:44s} {verdict.seconds:5.0f} s  {verdict.detail}", flush=True)
        return verdict

    with ThreadPoolExecutor(len(trees)) as pool:
        files = _by_file(chosen)
        print(f"the tests without a mistake: {len(files)} files", flush=True)
        baseline: dict[str, float] = {}
        try:
            for passed in pool.map(lambda ids: with_tree(lambda tree: _passing(tree, ids)), files.values()):
                baseline |= passed
            return list(pool.map(judge, chosen))
        except BaseException:
            for tree in trees:
                tree.stop()
            raise


def _check_control(trees: list[CopiedTree]) -> None:
    """The tests must import the copies: otherwise every mistake would escape, or worse."""
    for tree in trees:
        imported = Path(tree.package() or ".")
        if imported.parents[1].resolve() != tree.root.resolve():
            raise SystemExit(f"Python imports {imported}, not the copy at {tree.root}: nothing was planted")
        print(f"tests import {imported.parents[1]}", flush=True)


def _by_file(chosen: list[Mistake]) -> dict[str, list[str]]:
    """Ids of tests by their file; a whole file makes its single tests superfluous."""
    files: dict[str, dict[str, None]] = {}
    for mistake in chosen:
        for test in mistake.tests:
            files.setdefault(test.partition("::")[0], {})[test] = None
    return {file: [file] if file in ids else list(ids) for file, ids in files.items()}


def _passing(tree: CopiedTree, ids: list[str]) -> dict[str, float]:
    """Seconds of each test that passes, by node id, and of each file under its name."""
    report = tree.folder / "report.xml"
    report.unlink(missing_ok=True)
    status, text = tree.pytest([*_selection(ids), f"--junitxml={report}"], _BASELINE_TIMEOUT)
    if status != 0 or not report.exists():
        print(f"fails without any mistake: {' '.join(ids)}\n{text[-3000:]}", flush=True)
    if not report.exists():
        return {}
    file, found = ids[0].partition("::")[0], {}
    for case in ElementTree.parse(report).iter("testcase"):
        if not list(case.iter("failure")) and not list(case.iter("skipped")) and not list(case.iter("error")):
            found[f"{file}::{case.get('name')}"] = float(case.get("time") or 0)
    if found and status == 0:
        found[file] = sum(found.values())
    return found


def _selection(ids: Sequence[str]) -> list[str]:
    """Arguments of pytest: slow tests run only where they are named, as in `./run test`."""
    return [*ids] if any("::" in test for test in ids) else ["-m", "not slow", *ids]


def _verdict(tree: CopiedTree, mistake: Mistake, baseline: dict[str, float]) -> Verdict:
    if stale := mistake.stale(tree.root):
        return Verdict(mistake.name, "stale", stale)
    usual = 0.0
    for test in mistake.tests:
        own = [s for name, s in baseline.items() if name == test or name.startswith(f"{test}[")]
        if not own:
            return Verdict(mistake.name, "unusable", f"{test} does not pass without the mistake, or is skipped")
        usual += sum(own)
    started, caught = time.perf_counter(), ""
    restore = mistake.plant(tree.root)
    try:
        # Each file in a process of its own, the quickest first: most mistakes need only one.
        for ids in _by_file([mistake]).values():
            caught = _seen(*tree.pytest(["-x", *_selection(ids)], 10 * usual + 120))
            if caught:
                break
    finally:
        restore()
    return Verdict(
        mistake.name,
        "caught" if caught else "escaped",
        caught or mistake.escapes or "NOT EXPLAINED",
        time.perf_counter() - started,
    )


def _seen(status: int | None, text: str) -> str:
    """How a run saw the mistake, or an empty string. Raises RuntimeError where pytest itself could not run."""
    if status == 0:
        return ""
    if status is None:
        return "by a hang"
    if status in (_FAILED, _INTERRUPTED):
        # The title of a failure, or of a module that cannot be imported.
        title = re.search(r"^_+ (?:ERROR collecting |ERROR at \w+ of )?(\S.*?) _+$", text, re.MULTILINE)
        return f"by {title[1]}" if title else "by a failure"
    if status < 0:
        return f"by signal {-status}"
    raise RuntimeError(f"pytest ended with {status}:\n{text[-2000:]}")


def _report(chosen: list[Mistake], verdicts: list[Verdict]) -> int:
    of = {
        outcome: [v for v in verdicts if v.outcome == outcome] for outcome in ("caught", "escaped", "stale", "unusable")
    }
    explained = {m.name for m in chosen if m.escapes}
    for verdict in (v for outcome in ("escaped", "stale", "unusable") for v in of[outcome]):
        print(f"\n{verdict.outcome}: {verdict.name}\n    {verdict.detail}")
    for mistake in (m for m in chosen if m.escapes and m.name in {v.name for v in of["caught"]}):
        print(f"\ncaught although it is listed as one that escapes: {mistake.name}")
    rate = len(of["caught"]) / len(verdicts)
    print(f"\n{len(of['caught'])} of {len(verdicts)} mistakes caught, {rate:.1%}; {LEAST_RATE:.0%} must be")
    sound = not of["stale"] and not of["unusable"] and all(v.name in explained for v in of["escaped"])
    return 0 if sound and rate >= LEAST_RATE else 1

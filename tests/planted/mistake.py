"""One mistake that somebody could make, as a change of exact text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Mistake:
    """A planted mistake.

    Parameters
    ----------
    name : unique, of lower-case words with hyphens
    file : from the repository's root
    find : text that stands in the file exactly once; short, so that it outlives changes around it
    replace : what the mistake makes of it
    tests : files or node ids of the tests that should see it, the quickest first. Slow ones run only where named by
        their node id
    why : what a user would get
    escapes : where no test sees it, why that is accepted; empty for one that must be caught
    """

    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]
    why: str
    escapes: str = ""

    def stale(self, root: Path) -> str:
        """What keeps it from being planted into the tree at `root`, or an empty string."""
        path = root / self.file
        if not path.is_file():
            return f"{self.file} is no file"
        count = path.read_text(encoding="utf-8").count(self.find)
        if count != 1:
            return f"{self.file} holds its text {count} times, not once"
        if self.find == self.replace:
            return "it changes nothing"
        files = [test.partition("::")[0] for test in self.tests]
        missing = [file for file in files if not (root / file).is_file()]
        if missing or not files:
            return f"{missing[0]} is no file" if missing else "it names no test"
        gone = [test for test in self.tests if not _holds(root, test)]
        return f"{gone[0]} is no test" if gone else ""

    def plant(self, root: Path) -> Callable[[], object]:
        """Change the file under `root`; returns what undoes that."""
        path = root / self.file
        before = path.read_bytes()
        path.write_text(before.decode("utf-8").replace(self.find, self.replace), encoding="utf-8")
        return lambda: path.write_bytes(before)


def _holds(root: Path, test: str) -> bool:
    """Whether the file of a node id defines its function; parameters are not looked at."""
    file, _, name = test.partition("::")
    return not name or f"def {name.partition('[')[0]}(" in (root / file).read_text(encoding="utf-8")

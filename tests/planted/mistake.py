"""One mistake that somebody could make, as a change of exact text."""

from __future__ import annotations

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
        missing = [test for test in self.tests if not (root / test.partition("::")[0]).is_file()]
        return f"{missing[0]} is no file" if missing else "" if self.tests else "it names no test"

    def plant(self, root: Path) -> None:
        """Change the file under `root`."""
        path = root / self.file
        path.write_text(path.read_text(encoding="utf-8").replace(self.find, self.replace), encoding="utf-8")

"""What Flamenco's manager does with a job type, in QuickJS: the calls that its documentation names, and no more.

The manager runs scripts in goja, of which it documents `author.Task`, `author.Command`, `addTask`, `addCommand`,
`addDependency`, a task's `priority`, `shellSplit`, and the schema `AvailableJobSetting` of its API (version 3).
"""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import quickjs

# Of the schema: https://flamenco.blender.org, pkg/api/flamenco-openapi.yaml.
KEYS = {
    *("key", "type", "subtype", "choices", "propargs", "description", "label", "default", "eval", "evalInfo"),
    *("visible", "required", "editable"),
}
TYPES = {"string": str, "int32": int, "float": float, "bool": bool}
SUBTYPES = {"file_path", "dir_path", "file_name", "hashed_file_path"}
VISIBLE = {"visible", "hidden", "submission", "web"}

_MANAGER = """
const tasks = [];
const author = {
    Task: (name, type) => {
        if (!name || !type) throw "author.Task(name, type): both are required";
        return {name, type, priority: 50, commands: [], dependencies: [],
                addCommand(one) { this.commands.push(one); },
                addDependency(task) {
                    if (tasks.indexOf(task) < 0) throw "a dependency that is no task of the job";
                    this.dependencies.push(tasks.indexOf(task));
                }};
    },
    Command: (name, parameters) => ({name, parameters}),
};
const shellSplit = (text) => JSON.parse(splitWords(text));
const compiled = (text) => {
    const job = {...JSON.parse(text), addTask(task) { tasks.push(task); }};
    compileJob(job);
    return JSON.stringify(tasks);
};
"""


@dataclass(frozen=True)
class Task:
    """A task of a compiled job: its commands as name and parameters, and the tasks that it waits for."""

    name: str
    type: str
    priority: int
    commands: tuple[tuple[str, dict[str, Any]], ...]
    waits_for: tuple[str, ...]


class JobType:
    """A job type's script, loaded."""

    def __init__(self, script: Path) -> None:
        self._script = script.read_text(encoding="utf-8")
        self.facts: dict[str, Any] = json.loads(self._loaded().eval("JSON.stringify(JOB_TYPE)"))
        self.name = script.stem.replace("_", "-")

    def compiled(self, job: dict[str, Any]) -> list[Task]:
        """Tasks of a submitted job, whose settings have the defaults that the manager's clients fill in.

        Raises `quickjs.JSException`.
        """
        settings = {one["key"]: one["default"] for one in self.facts["settings"] if "default" in one}
        context = self._loaded()
        context.set("submitted", json.dumps({**job, "settings": {**settings, **job["settings"]}}))
        made = json.loads(context.eval("compiled(submitted)"))
        names = [one["name"] for one in made]
        return [
            Task(
                one["name"],
                one["type"],
                one["priority"],
                tuple((command["name"], command["parameters"]) for command in one["commands"]),
                tuple(names[number] for number in one["dependencies"]),
            )
            for one in made
        ]

    def _loaded(self) -> Any:
        context = quickjs.Context()
        context.add_callable("splitWords", lambda text: json.dumps(shlex.split(text)))
        context.eval(_MANAGER)
        context.eval(self._script)
        return context

"""First lines of a worker process: whatever runs this file is given the package by its standard input.

The package gets the name that it has in the process that asks, or nothing could be sent between the two: inside Blender
it is called `bl_ext.<repository>.measured_materials`. Nothing but Python itself is imported before that.
"""

import importlib
import importlib.util
import json
import sys
import types


def start():
    """Read one line about the package, import it and hand over to its worker."""
    # Beside this file lie modules that might be taken for Python's own.
    sys.path[:] = [place for place in sys.path if place and not place.rstrip("/\\").endswith("baking")]
    about = json.loads(sys.stdin.buffer.readline())
    sys.path += [place for place in about["path"] if place not in sys.path]
    name = about["package"]
    parts = name.split(".")
    for count in range(1, len(parts)):
        above = ".".join(parts[:count])
        if above not in sys.modules:
            sys.modules[above] = types.ModuleType(above)
            sys.modules[above].__path__ = []
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, about["init"], submodule_search_locations=[about["folder"]])
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    importlib.import_module(name + "." + about["worker"]).main()


start()

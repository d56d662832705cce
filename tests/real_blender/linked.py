"""Run inside a real Blender by check.py: a scene of a material that lies in another .blend.

Argument: the folder that textures.py has made.
"""

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path.cwd()))
from common import HERE, empty_scene, lamp, save, square

FOLDER = HERE / sys.argv[sys.argv.index("--") + 1]

scene = empty_scene()
lamp(scene, (0, 1, 3))
square(scene)
with bpy.data.libraries.load(str(FOLDER / "scene.blend"), link=True) as (_there, wanted):
    wanted.materials = ["lacquer"]
bpy.context.object.active_material = wanted.materials[0]
save(FOLDER / "linked.blend")
print("linked: all is well")

"""Many bakes at once: what there is to bake, under which names, on all cores or on a cluster; no bpy."""

"""Inside a real Blender window: whether the words of a panel fit where it draws them, by the window's own font.

A panel draws into a layout of this module, which knows what share of the width each row, column and part has, and
compares it with the width of the words.
"""

import blf
import bpy

# Pixels at a UI scale of 1: an icon, what a label and a button keep free, a panel's borders, and the arrow of a list.
_ICON, _LABEL, _BUTTON, _BORDERS, _ARROW = 20, 6, 12, 20, 20
# The part of a row that a property's name has.
_NAMES = 0.4


def measure(text):
    """Pixels at a UI scale of 1."""
    preferences = bpy.context.preferences
    scale = preferences.system.ui_scale
    blf.size(0, preferences.ui_styles[0].widget.points * scale)
    return blf.dimensions(0, text)[0] / scale


class _Anything:
    """Takes an operator's settings."""


class Layout:
    """A tree of what is drawn: leaves are words with the pixels that they need."""

    def __init__(self, kind="column", factor=0.0, split=False, grown=1.0):
        self.kind, self.factor, self.parts, self.columns = kind, factor, [], 1
        self.use_property_split, self.scale_y = split, grown

    def __getattr__(self, name):
        return lambda *_, **__: self  # separators and pictures have no words

    def _inner(self, kind, factor=0.0):
        made = Layout(kind, factor, self.use_property_split)
        self.parts.append(made)
        return made

    def column(self, **_):
        return self._inner("column")

    def row(self, **_):
        return self._inner("row")

    def grid_flow(self, columns=1, **_):
        made = self._inner("grid")
        made.columns = columns
        return made

    def split(self, factor=0.0, **_):
        return self._inner("split", factor)

    def _words(self, text, more):
        self.parts.append((text, measure(text) + more if text else _ICON))

    def label(self, text="", icon="NONE", **_):
        self._words(text, _LABEL + (_ICON if icon != "NONE" else 0))

    def operator(self, name, text=None, icon="NONE", **_):
        group, _, own = name.partition(".")
        if text is None:
            text = getattr(getattr(bpy.ops, group), own).get_rna_type().name
        self._words(text, _BUTTON + (_ICON if icon != "NONE" else 0))
        return _Anything()

    def prop_enum(self, data, name, value, text=None, **_):
        self._words(data.bl_rna.properties[name].enum_items[value].name if text is None else text, _BUTTON)

    def template_node_view(self, _tree, _node, socket):
        self._named(socket.name, "")

    def prop_search(self, data, name, _where, _list, text=None, **_):
        self._named(data.bl_rna.properties[name].name if text is None else text, "")

    def prop(self, data, name, text=None, icon="NONE", **_):
        prop = data.bl_rna.properties[name]
        text = prop.name if text is None else text
        if prop.type == "BOOLEAN":
            part = self._inner("split", _NAMES) if self.use_property_split else self
            if part is not self:
                part.label()
            part._words(text, _ICON + _LABEL)
            return
        chosen = ""
        if prop.type == "ENUM":
            chosen = next((item.name for item in prop.enum_items if item.identifier == getattr(data, name)), "")
        self._named(text, chosen)

    def _named(self, text, value):
        if not self.use_property_split:
            self._words(text, _BUTTON)
            return
        part = self._inner("split", _NAMES)
        part._words(text, _LABEL)
        part._words(value, _BUTTON + _ARROW)

    def cut(self, width):
        """Words that do not fit: (words, pixels needed, pixels there)."""
        found = []
        for part, room in zip(self.parts, self._rooms(width)):
            if isinstance(part, Layout):
                found += part.cut(room)
            elif part[1] > room + 1 and part[0]:
                found.append((part[0], round(part[1]), round(room)))
        return found

    def _rooms(self, width):
        """Of each part."""
        if self.kind == "split" and self.factor and len(self.parts) == 2:
            return [width * self.factor, width * (1 - self.factor)]
        if self.kind == "column":
            return [width] * len(self.parts)
        if self.kind == "grid":
            return [width / self.columns] * len(self.parts)
        icons = sum(1 for part in self.parts if not isinstance(part, Layout) and not part[0])
        equal = (width - icons * _ICON) / max(len(self.parts) - icons, 1)
        return [_ICON if not isinstance(part, Layout) and not part[0] else equal for part in self.parts]


def cut_words(panels, area, region):
    """What of these classes' words does not fit into a region; empty if all is well."""
    scale, found = bpy.context.preferences.system.ui_scale, {}
    window = bpy.context.window_manager.windows[0]
    tabs = 22 if region.type == "UI" else 0
    with bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region):
        for cls in panels:
            if hasattr(cls, "poll") and not cls.poll(bpy.context):
                continue
            layout = Layout()
            cls.draw(type("Shown", (), {"layout": layout})(), bpy.context)
            if cut := layout.cut(region.width / scale - tabs - _BORDERS):
                found[cls.__name__] = cut
    return found

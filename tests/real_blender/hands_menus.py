"""Inside a real Blender window: menus, the file browser, lists of choices and dialogues, by mouse and keys."""

import functools

import bpy
from hands import (
    across,
    area_of,
    by_sight,
    check,
    click,
    dialogues,
    hovered,
    keys,
    move,
    note,
    picture,
    press,
    region_of,
    rows_in,
    soon,
    unit,
    window,
)

# --- menus -----------------------------------------------------------------------------------------------


class _Counting:
    """A layout that only notes the rows that are made."""

    def __init__(self):
        self.rows = []

    def __getattr__(self, name):
        if name in ("operator", "menu", "operator_menu_enum"):
            return self._row
        if name in ("row", "column", "split", "box"):
            return lambda *_, **__: self
        return lambda *_, **__: None

    def _row(self, name, *_, **__):
        self.rows.append(name)
        return _Counting()


def rows_of(menu):
    """Names of the operators and menus in a menu, in their order."""
    layout = _Counting()
    owner = type("Owner", (), {"layout": layout, "bl_idname": menu})()
    with bpy.context.temp_override(window=window()):
        for draw in getattr(bpy.types, menu)._dyn_ui_initialize():
            draw(owner, bpy.context)
    return layout.rows


@by_sight
def file_import(operator):
    """File > Import > this operator: a click on File, then arrow keys."""
    shown = []
    menus = [bpy.types.TOPBAR_MT_file, bpy.types.TOPBAR_MT_file_import]
    draws = [lambda self, context, name=menu.__name__: shown.append(name) for menu in menus]
    for menu, draw in zip(menus, draws):
        menu.append(draw)
    try:
        for place in range(3, 12):  # the menu of Blender itself comes before it
            yield from move(place * unit() / 2, window().height - unit() / 2)
            shown.clear()
            yield from click()
            if menus[0].__name__ in shown:
                break
            yield from keys("Escape")
        else:
            raise RuntimeError("no menu File")
        yield from keys(*["Down"] * (rows_of(menus[0].__name__).index(menus[1].__name__) + 1), "Right")
        check("the menu File > Import is open", menus[1].__name__ in shown)
        rows = rows_of(menus[1].__name__)
        yield from keys(*["Up"] * (len(rows) - rows.index(operator)))
        yield from picture(f"menu_{operator.rpartition('.')[2]}")
        yield from keys("Return")
    finally:
        for menu, draw in zip(menus, draws):
            menu.remove(draw)


def browser_open():
    """Wait for the file browser."""
    yield from soon("the file browser is open", lambda: any(a.type == "FILE_BROWSER" for a in window().screen.areas))
    yield 1.0


@by_sight
def choose_file(name):
    """In the file browser: arrow keys to the file."""
    yield from browser_open()
    area = area_of("FILE_BROWSER")
    region = region_of(area)
    yield from move(across(region, 0.5), region.y + region.height / 3)
    yield from click()  # where no file is: ends the editing of the folder's path
    for _ in range(40):
        if area.spaces.active.params.filename == name:
            return
        yield from keys("Down")
    raise RuntimeError(f"no file {name} in {area.spaces.active.params.directory}")


def choose(area, wanted, letter, **where):
    """Open a list of choices and press the letter that is underlined in one of them."""
    yield from press(area, wanted, **where)
    yield from keys(letter)


@by_sight
def open_tab(area, context):
    """Click through the tabs of a properties editor to this one."""
    region = region_of(area, "NAVIGATION_BAR")
    for y in rows_in(region):
        if area.spaces.active.context == context:
            break
        yield from move(across(region, 0.5), y)
        if hovered(area, region).endswith("context"):
            yield from click()
    check(f"the tab {context} is open", area.spaces.active.context == context)


# --- dialogues -------------------------------------------------------------------------------------------


def watch_dialogue(operator):
    """Keep an operator's dialogue as it draws."""
    draw = operator.draw

    @functools.wraps(draw)
    def noted(self, context):
        dialogues[operator.__name__] = (self, getattr(context, "region_popup", None) or context.region)
        draw(self, context)

    operator.draw = noted


def _box(operator):
    """Where the dialogue is, which it learns only after its first drawing; while it is open."""
    region = dialogues[operator][1]
    note(f"dialogue at {region.x}, {region.y}, {region.width} by {region.height}")
    return region.x, region.y, region.width, region.height


def _in_dialogue(operator, part):
    """Places in the dialogue that is open, from the row above its buttons up."""
    x, y, width, height = _box(operator)
    step = unit() / 2
    return [(x + part * width, y + 2.6 * unit() + step * number) for number in range(int(height / step) - 6)]


def switch_in_dialogue(operator, name, part):
    """Click this switch of the operator; `part` is its place in the width."""
    before = getattr(dialogues[operator][0], name)
    yield from hover_in_dialogue(operator, name, part)
    yield from click()
    yield from soon(f"{name} is switched", lambda: getattr(dialogues[operator][0], name) != before)
    yield 0.5


@by_sight
def hover_in_dialogue(operator, name, part=0.75, above=0.0):
    """Put the mouse onto the lowest button of a property, above a height: what each is, a click with the right button
    tells. Returns its height.
    """
    told = []
    menu = bpy.types.UI_MT_button_context_menu
    tell = lambda self, context: told.append(getattr(getattr(context, "button_prop", None), "identifier", ""))  # noqa: E731
    menu.append(tell)
    try:
        for place in _in_dialogue(operator, part):
            if place[1] <= above:
                continue
            told.clear()
            yield from move(*place)
            yield from click(3)
            if told:
                yield from keys("Escape")
            if name in told:
                yield from move(*place)
                return place[1]
    finally:
        menu.remove(tell)
    raise RuntimeError(f"no {name} in the dialogue")


def open_part(operator, name, part):
    """Click this of the tabs; `part` is its place in the width."""
    height = 0.0
    while dialogues[operator][0].part != name:
        height = yield from hover_in_dialogue(operator, "part", part, height)
        yield from click()
        yield 0.3


def leave_buttons(operator):
    """Put the mouse onto the dialogue's title, where the return key confirms all of it."""
    x, y, width, height = _box(operator)
    yield from move(x + width / 2, y + height - 1.5 * unit())

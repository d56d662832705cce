"""Inside a real Blender window: mouse and keys through the X server, and what lies under the mouse.

Nothing here knows where a button is. The mouse goes over a region row by row, as a person's does, and Blender is asked
what it hovers over: a property or an operator. Headings of panels are clicked where no button is until the panel that
is wanted draws. Menus and dialogues are in hands_menus.py.
"""

import ctypes
import functools
import re
import subprocess
import time
from pathlib import Path

import bpy

HERE = Path.cwd()
# Seconds in which Blender sees that the mouse has moved, and draws what a click has changed.
_MOVED, _DRAWN = 0.03, 0.3
journal = (HERE / "journal.txt").open("w", buffering=1)
began = time.monotonic()
# Names of panels in the order in which they have drawn; dialogues as they drew last, with their regions. Where buttons
# were found.
drawn, dialogues, lately = [], {}, {}
# Seconds in which a person finds a button by sight and points at it: of the keystroke-level model of Card, Moran and
# Newell 1980 the operators M and P. Searches that are going on, and what those that have ended took.
_BY_SIGHT = 1.35 + 1.1
_searching, _searched = [], []


def note(words):
    """One line, on the disk before what comes next."""
    journal.write(f"{time.monotonic() - began:6.1f} {words}\n")


def check(words, ok):
    """One thing that must be so."""
    note(f"{'ok  ' if ok else 'FAIL'} {words}")
    if not ok:
        raise RuntimeError(words)


def soon(words, condition, seconds=120.0):
    """What must be so before long: a busy machine may take its time."""
    until = time.monotonic() + seconds
    while not condition() and time.monotonic() < until:
        yield 0.1
    check(words, condition())


def picture(name):
    """The whole screen, once it is drawn."""
    yield 2 * _DRAWN
    take(name)


def take(name):
    """The whole screen at once."""
    subprocess.run(["import", "-window", "root", str(HERE / f"{name}.png")], check=True)


def by_sight(search):
    """A search that only a program makes, row by row: the time is not an artist's, who sees where the button is."""

    @functools.wraps(search)
    def timed(*arguments, **named):
        start = time.monotonic()
        _searching.append(search)
        try:
            return (yield from search(*arguments, **named))
        finally:
            _searching.pop()
            if not _searching:
                _searched.append(time.monotonic() - start)

    return timed


def stopwatch():
    """A function that returns the seconds since now: as an artist's, by the clock, and how often was searched."""
    start, before = time.monotonic(), len(_searched)

    def read():
        clock, searches = time.monotonic() - start, _searched[before:]
        return clock - sum(searches) + _BY_SIGHT * len(searches), clock, len(searches)

    return read


# --- mouse and keys --------------------------------------------------------------------------------------


def window():
    """The window."""
    return bpy.context.window_manager.windows[0]


def unit():
    """Pixels of a row."""
    return 20 * bpy.context.preferences.system.ui_scale


def send(*words, seconds=_DRAWN):
    """Have xdotool do this, and wait until Blender has dealt with it, and for these seconds at least.

    The X server has passed it on once it answers the question that is asked last. Blender reads events, then has timers
    run, by which we come here again, and then deals with what it has read: so one more round of its main loop is
    waited for, however long it takes.
    """
    subprocess.run(["xdotool", *map(str, words)], check=True)
    subprocess.run(["xdotool", "getmouselocation"], check=True, stdout=subprocess.DEVNULL)
    yield seconds
    yield 0.0


def move(x, y):
    """The mouse, by Blender's own coordinates, which grow upwards."""
    yield from send("mousemove", round(x), window().height - round(y), seconds=_MOVED)


def click(button=1, times=1):
    """Where the mouse is."""
    yield from send("click", "--repeat", times, "--delay", 60, button)


def wheel(steps):
    """Downwards, or upwards where negative."""
    if steps:
        yield from send("click", "--repeat", abs(steps), "--delay", 15, 5 if steps > 0 else 4)


def keys(*names):
    """One after the other."""
    yield from send("key", "--delay", 40, *names, seconds=_DRAWN + 0.02 * len(names))


def function_key(number):
    """F1 to F12 by its code: of its name xdotool makes the one with Alt on some layouts."""
    server = ctypes.CDLL("libX11.so.6")
    server.XOpenDisplay.restype = ctypes.c_void_p
    display = ctypes.c_void_p(server.XOpenDisplay(None))
    code = server.XKeysymToKeycode(display, ctypes.c_ulong(0xFFBD + number))
    server.XCloseDisplay(display)
    yield from keys(str(code))


def write(text):
    """In a field whose text is edited, in place of what it holds."""
    yield 1.0  # until a busy machine has made a field to write in of the double click
    yield from keys("ctrl+a")
    yield from send("type", "--delay", 25, text)
    yield from keys("Return")


# --- what the mouse hovers over --------------------------------------------------------------------------


def area_of(kind):
    """The first area of this type."""
    return next(area for area in window().screen.areas if area.type == kind)


def region_of(area, kind="WINDOW"):
    """A region of it."""
    return next(region for region in area.regions if region.type == kind)


def hovered(area, region):
    """The property as its path, or the operator as its call; empty for what is neither."""
    with bpy.context.temp_override(window=window(), screen=window().screen, area=area, region=region):
        found = getattr(bpy.context, "property", None)
        manager = bpy.context.window_manager
        manager.clipboard = ""
        if found is not None and bpy.ops.ui.copy_data_path_button.poll():
            bpy.ops.ui.copy_data_path_button(full_path=True)
        elif found is None and bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
        # An editor's own settings have no such path.
        return manager.clipboard or ("" if found is None else f"{found[0].name}: {found[1]}")


def across(region, part):
    """A place from the left border to the right one, by its part of the width."""
    return region.x + region.width * part


def rows_in(region):
    """Heights from the top down, close enough to hit each row."""
    step = 0.9 * unit()
    count = int(region.height / step)
    return [region.y + region.height - step * (number + 0.5) for number in range(count)]


def on_screen(area, region, part, until=None):
    """What lies where, from the top down: pairs of height and words; ends at what holds the words `until`."""
    found = []
    for y in rows_in(region):
        yield from move(across(region, part), y)
        found.append((y, hovered(area, region)))
        if until and is_meant(until, found[-1][1]):
            break
    return found


def is_meant(wanted, words):
    """Whether this is the button, and no other property whose name only begins so."""
    return re.search(rf"{re.escape(wanted)}(?!\w)", words) is not None


@by_sight
def hover(area, wanted, region="WINDOW", part=0.7):
    """Put the mouse onto the button whose words hold `wanted`, turning the wheel if need be."""
    place, before = region_of(area, region), None
    if wanted in lately and (yield from _is_at(area, place, lately[wanted], wanted)):
        return
    for turn in range(12):
        seen = yield from on_screen(area, place, part, wanted)
        if is_meant(wanted, seen[-1][1]):
            lately[wanted] = across(place, part), seen[-1][0]
            return
        words = [words for _, words in seen]
        if turn > 1 and words == before:  # the end; the second look is from the top, where the first may have been
            break
        before = words
        yield from move(across(place, 0.5), place.y + place.height / 2)
        yield from wheel(8 if turn else -60)
    raise RuntimeError(f"no {wanted} in {area.type}, {region}; there are {sorted(set(before or ()))}")


def _is_at(area, region, place, wanted):
    """Whether the button is there."""
    yield from move(*place)
    return is_meant(wanted, hovered(area, region))


def press(area, wanted, **where):
    """Click the button whose words hold `wanted`."""
    yield from hover(area, wanted, **where)
    yield from click()


def type_into(area, wanted, text, **where):
    """Write into a field of a number."""
    yield from hover(area, wanted, **where)
    yield from click(times=2)
    yield from write(text)


# --- panels ----------------------------------------------------------------------------------------------


def watch_panels(prefix):
    """Note which of these panels draw."""
    for cls in bpy.types.Panel.__subclasses__():
        if cls.__name__.startswith(prefix):
            cls.draw = _told(cls.draw, cls.__name__.rpartition("_")[2])


def _told(draw, name):
    def noted(self, context):
        drawn.append(name)
        draw(self, context)

    return noted


def _redrawn(area):
    """Names of panels that draw now."""
    drawn.clear()
    area.tag_redraw()
    yield _DRAWN
    return set(drawn)


@by_sight
def open_panel(area, name):
    """Click headings of panels, from the top down, until this one draws; every other is left as it was."""
    if name in (yield from _redrawn(area)):
        return
    region = region_of(area)
    yield from move(across(region, 0.5), region.y + region.height / 2)
    yield from wheel(-60)
    for _ in range(6):
        for y in rows_in(region):
            yield from move(across(region, 0.7), y)
            if hovered(area, region):
                continue
            before = yield from _redrawn(area)
            yield from move(across(region, 0.3), y)
            yield from click()
            now = yield from _redrawn(area)
            if name in now:
                return
            if now != before:
                yield from click()
        yield from wheel(8)
    raise RuntimeError(f"no heading of the panel {name}")

"""Radiance's tensor trees (Ward, Mistrick, Lee, McNeil & Jonsson 2011), looked up without interpolation.

Directions are points of a square, by the concentric map of Shirley & Chiu (1997) of the direction's projection. Of
rank 4, the first two coordinates are the square of the direction in which light travels, of rank 3 the first is 0.5 -
0.5 sin theta_i and the outgoing direction is turned so that light travels along +x. A node in braces has 2^n nodes or
one value or (2^k)^n values. Among nodes the *first* coordinate is the lowest bit, in a grid of values it is the
slowest: exchanged, 225 of 300 lookups differ from those of Radiance's own library.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import BakeError
from ...source import Array
from ..lookup.lookup_source import negative_facts
from ..lookup.text_file import LARGEST_VALUE, printable

MAX_NODES = 1 << 24
MAX_DEPTH = 12
_REMEDY = "give a tensor tree as genBSDF or bsdf2ttree wrote it"
_TOKENS = re.compile(r"[{}]|[^\s,{}]+")


@dataclass(frozen=True)
class Tree:
    """A tree of rank n, flat.

    Parameters
    ----------
    children : (branches, 2^n) of what each child is: a branch if >= 0, else the leaf -1 - child
    starts, sides : (leaves,) where a leaf's values begin, and how many there are along a coordinate
    values : all leaves' values
    root : branch or leaf, as in `children`
    """

    rank: int
    children: Array
    starts: Array
    sides: Array
    values: Array
    root: int

    def __call__(self, point: Array) -> Array:
        """Values at points (n, rank) of the unit cube, (n,)."""
        point = np.clip(point, 0.0, np.nextafter(1.0, 0.0))
        node = np.full(len(point), self.root, np.intp)
        bits = 1 << np.arange(self.rank)
        inner = np.flatnonzero(node >= 0)
        place = point.copy()
        while inner.size:
            doubled = place[inner] * 2
            high = np.floor(doubled)
            place[inner] = doubled - high
            node[inner] = self.children[node[inner], (high.astype(np.intp) * bits).sum(-1)]
            inner = inner[node[inner] >= 0]
        leaf = -1 - node
        side = self.sides[leaf]
        cell = np.floor(place * side[:, None]).astype(np.intp)
        index = cell[:, 0]
        for d in range(1, self.rank):
            index = index * side + cell[:, d]
        values: Array = self.values[self.starts[leaf] + index]
        return values


def tree_lookup(
    path: Path, structure: str, block: ElementTree.Element
) -> tuple[Callable[[Array, Array], Array], dict[str, Any]]:
    """The values of a block, as a function of (wi, wo), (n, 3) each, to (n,), and facts. Raises BakeError."""
    basis = (block.findtext("AngleBasis") or "").strip()
    if basis.lower() != "lbnl/shirley-chiu":
        raise BakeError(path, f"a tree over the directions {printable(basis, 40)!r}", "give one over LBNL/Shirley-Chiu")
    rank = int(structure[-1])
    tree = parse_tree(path, block.findtext("ScatteringData") or "", rank)

    def lookup(wi: Array, wo: Array) -> Array:
        if rank == 4:
            point = np.concatenate([square(-wi[:, :2]), square(wo[:, :2])], -1)
        else:
            sine = np.hypot(wi[:, 0], wi[:, 1])
            safe = np.where(sine > 0, sine, 1.0)
            # Along which light travels, as a unit vector; light along the normal takes +x.
            cos_phi, sin_phi = np.where(sine > 0, -wi[:, 0] / safe, 1.0), np.where(sine > 0, -wi[:, 1] / safe, 0.0)
            x = cos_phi * wo[:, 0] + sin_phi * wo[:, 1]
            y = cos_phi * wo[:, 1] - sin_phi * wo[:, 0]
            point = np.column_stack([0.5 - 0.5 * sine, square(np.stack([x, y], -1))])
        return np.maximum(tree(point), 0)

    return lookup, {"entries": [tree.values.size], "rank": rank, **negative_facts(tree.values)}


def square(disk: Array) -> Array:
    """Points of the unit disk, (n, 2), on the unit square (Shirley & Chiu 1997, inverse of the concentric map)."""
    x, y = disk[:, 0], disk[:, 1]
    radius = np.minimum(np.hypot(x, y), 1.0)
    phi = np.arctan2(y, x)
    phi = np.where(phi < -np.pi / 4, phi + 2 * np.pi, phi)
    quarter = np.clip(np.floor((phi + np.pi / 4) / (np.pi / 2)), 0, 3).astype(int)
    across = (phi - quarter * (np.pi / 2)) * radius / (np.pi / 4)
    a = np.choose(quarter, [radius, -across, -radius, across])
    b = np.choose(quarter, [across, radius, -across, -radius])
    return np.stack([(a + 1) / 2, (b + 1) / 2], -1)


def parse_tree(path: Path, text: str, rank: int) -> Tree:
    """A tree from its nested braces. Raises BakeError: unbalanced, a wrong number of children or values."""

    def refuse(cause: str) -> BakeError:
        return BakeError(path, f"a tensor tree {cause}", _REMEDY)

    children: list[list[int]] = []
    starts, sides, values = [], [], list[float]()
    # Each open node: the nodes found in it, and its numbers.
    stack: list[tuple[list[int], list[float]]] = []
    root: int | None = None
    for match in _TOKENS.finditer(text):
        token = match.group()
        if token == "{":
            if len(stack) > MAX_DEPTH or root is not None:
                raise refuse("is deeper than any" if root is None else "goes on behind its end")
            stack.append(([], []))
        elif token == "}":
            if not stack:
                raise refuse("closes more braces than it opens")
            nodes, numbers = stack.pop()
            if nodes:
                if numbers or len(nodes) != 1 << rank:
                    raise refuse(f"has a node of {len(nodes)} nodes and {len(numbers)} numbers")
                children.append(nodes)
                made = len(children) - 1
            else:
                side = _side(len(numbers), rank)
                if not side:
                    raise refuse(f"has a node of {len(numbers)} numbers")
                starts.append(len(values))
                sides.append(side)
                values += numbers
                made = -len(starts)
            if len(children) + len(values) > MAX_NODES:
                raise refuse(f"has more than {MAX_NODES} values")
            if stack:
                stack[-1][0].append(made)
            else:
                root = made
        else:
            try:
                number = float(token)
            except ValueError:
                raise refuse(f"holds {token[:20]!r}, which is no number") from None
            if not abs(number) <= LARGEST_VALUE or not stack:
                raise refuse(f"holds {token[:20]!r}, which is out of range or outside of braces")
            stack[-1][1].append(number)
    if root is None or stack:
        raise refuse("is empty" if not text.strip() else "opens more braces than it closes")
    table = np.array(children, np.intp).reshape(-1, 1 << rank)
    return Tree(rank, table, np.array(starts, np.intp), np.array(sides, np.intp), np.array(values), root)


def _side(count: int, rank: int) -> int:
    """2^k for (2^k)^rank numbers, else 0."""
    k = (count.bit_length() - 1) // rank if count else 0
    return 1 << k if count and 1 << (k * rank) == count else 0

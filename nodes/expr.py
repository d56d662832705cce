"""Arithmetic on shader-node sockets: inside `building(tree)`, `1 - cos_d` adds a Math node to that tree.

The names offered here are those of `bake.xp_numpy`, so that a formula written against `xp` runs in numpy as the
truth and in Cycles as a node group. Equal expressions become one node: a shared subexpression is computed once and
takes one place on the SVM stack. Arithmetic among plain numbers stays in Python and adds no node.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from operator import itemgetter
from typing import Any

import numpy as np

from .recording import CannotRecord, Recording

pi = np.pi


class _Builder:
    """The tree under construction, or its recording, and the nodes already made for an expression."""

    def __init__(self, tree: Any) -> None:
        self.tree = tree
        self.made: dict[Any, Any] = {}


_stack: list[_Builder] = []


@contextmanager
def building(tree: Any) -> Iterator[Any]:
    """Direct all expressions inside the block into `tree`: a bpy shader node tree, or a `Recording` of one to be."""
    _stack.append(_Builder(tree))
    try:
        yield tree
    finally:
        _stack.pop()


class Scalar:
    """A float socket."""

    __hash__ = object.__hash__

    def __init__(self, socket: Any) -> None:
        self.socket = socket

    def __add__(self, other: Any) -> Any:
        return self if _is(other, 0) else math_node("ADD", self, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self if _is(other, 0) else math_node("SUBTRACT", self, other)

    def __rsub__(self, other: Any) -> Any:
        return math_node("SUBTRACT", other, self)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Vector):
            return NotImplemented
        return self if _is(other, 1) else math_node("MULTIPLY", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return math_node("DIVIDE", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return math_node("DIVIDE", other, self)

    def __neg__(self) -> Any:
        return math_node("MULTIPLY", self, -1.0)

    def __lt__(self, other: Any) -> Any:
        return math_node("LESS_THAN", self, other)

    def __gt__(self, other: Any) -> Any:
        return math_node("GREATER_THAN", self, other)

    def __bool__(self) -> bool:
        raise TypeError("a socket has no truth value when the group is built; use where()")


class Vector:
    """A vector or colour socket, or a constant triple that needs no node."""

    __hash__ = object.__hash__

    def __init__(self, socket: Any = None, constant: tuple[float, float, float] | None = None) -> None:
        self.socket, self.constant = socket, constant

    def __add__(self, other: Any) -> Any:
        return vector_node("ADD", self, other)

    def __sub__(self, other: Any) -> Any:
        return vector_node("SUBTRACT", self, other)

    def __mul__(self, other: Any) -> Any:
        return vector_node("MULTIPLY", self, other) if isinstance(other, Vector) else scale(self, other)

    __rmul__ = __mul__

    def __neg__(self) -> Any:
        return scale(self, -1.0)


Value = Any  # Scalar | Vector | float
# What a node's inputs are fed, by name or by place. A mapping's keys are invariant: one of names is none of both kinds.
Inputs = Mapping[str, Value] | Mapping[int, Value] | Mapping[int | str, Value]


def _is(value: Value, number: float) -> bool:
    return isinstance(value, (int, float)) and value == number


def key_of(value: Value) -> Any:
    """What an expression or a constant is known by: equal ones give equal keys."""
    if isinstance(value, Vector) and value.constant is not None:
        return ("constant", *value.constant)
    if isinstance(value, (Scalar, Vector)):
        socket = value.socket
        return (socket.node.name, socket.identifier)
    return float(value) if isinstance(value, (int, float, np.floating)) else value


def feed(tree: Any, socket: Any, value: Value) -> None:
    """Give a node's input a value: a link from an expression, or a default from a number or triple."""
    if isinstance(value, Vector) and value.constant is not None:
        # Colour sockets have an alpha.
        socket.default_value = (*value.constant, 1.0) if socket.type == "RGBA" else value.constant
    elif isinstance(value, (Scalar, Vector)):
        tree.links.new(value.socket, socket)
    else:
        socket.default_value = value


def node(kind: str, properties: Mapping[str, Any], inputs: Inputs) -> Any:
    """A node of this bl_idname with properties set and inputs fed; an equal one is made only once."""
    builder = _stack[-1]
    settings = sorted(properties.items(), key=itemgetter(0)) if len(properties) > 1 else properties.items()
    key = (kind, tuple(settings), tuple([(i, key_of(value)) for i, value in inputs.items()]))
    if key not in builder.made:
        if isinstance(builder.tree, Recording):
            builder.made[key] = builder.tree.add(*key)
        else:
            builder.made[key] = _made(builder.tree, kind, properties, inputs)
    return builder.made[key]


def _made(tree: Any, kind: str, properties: Mapping[str, Any], inputs: Inputs) -> Any:
    made = tree.nodes.new(kind)
    for name, value in properties.items():
        setattr(made, name, value)
    for index, value in inputs.items():
        feed(tree, made.inputs[index], value)
    return made


def need_tree() -> None:
    """Call where a function is to do more in the tree than to add nodes. Raises CannotRecord where that is recorded."""
    if _stack and isinstance(_stack[-1].tree, Recording):
        raise CannotRecord


def math_node(operation: str, *operands: Value) -> Scalar:
    """A Math node."""
    return Scalar(node("ShaderNodeMath", {"operation": operation}, dict(enumerate(operands))).outputs[0])


def vector_node(operation: str, *operands: Value) -> Any:
    """A Vector Math node on vectors; dot products and lengths give a Scalar."""
    made = node("ShaderNodeVectorMath", {"operation": operation}, dict(enumerate(operands)))
    if operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE"):
        return Scalar(made.outputs["Value"])
    return Vector(made.outputs["Vector"])


def sqrt(x: Value) -> Any:
    """Square root, 0 for negative arguments."""
    return math_node("SQRT", x)


def sin(x: Value) -> Any:
    """Sine."""
    return math_node("SINE", x)


def cos(x: Value) -> Any:
    """Cosine."""
    return math_node("COSINE", x)


def tanh(x: Value) -> Any:
    """Hyperbolic tangent."""
    return math_node("TANH", x)


def exp(x: Value) -> Any:
    """e to the power of x."""
    return math_node("EXPONENT", x)


def log(x: Value) -> Any:
    """Natural logarithm, 0 for x <= 0."""
    return math_node("LOGARITHM", x, float(np.e))


def arcsin(x: Value) -> Any:
    """Arcsine, its argument clamped to [-1, 1]."""
    return math_node("ARCSINE", x)


def arctan2(y: Value, x: Value) -> Any:
    """Angle of the point (x, y), 0 at the origin."""
    return math_node("ARCTAN2", y, x)


def floor(x: Value) -> Any:
    """Largest whole number below."""
    return math_node("FLOOR", x)


def minimum(a: Value, b: Value) -> Any:
    """Smaller of two scalars."""
    return math_node("MINIMUM", a, b)


def maximum(a: Value, b: Value) -> Any:
    """Larger of two scalars."""
    return math_node("MAXIMUM", a, b)


def divide(a: Value, b: Value) -> Any:
    """Quotient, 0 where the divisor is 0."""
    return math_node("DIVIDE", a, b)


def power(x: Value, exponent: Value) -> Any:
    """x ** exponent for x >= 0; SVM and OSL disagree on a negative base, so it is held at 0."""
    return math_node("POWER", maximum(x, 0.0), exponent)


def where(condition: Value, a: Value, b: Value) -> Any:
    """`a` where the condition is 1, `b` where it is 0; both must be finite, for they are blended."""
    if isinstance(a, Vector) or isinstance(b, Vector):
        made = node(
            "ShaderNodeMix",
            {"data_type": "VECTOR", "clamp_factor": False},
            {0: condition, 4: b, 5: a},
        )
        return Vector(made.outputs[1])
    # The Mix node names sockets alike for every type; they differ by their place.
    made = node(
        "ShaderNodeMix",
        {"data_type": "FLOAT", "clamp_factor": False},
        {0: condition, 2: b, 3: a},
    )
    return Scalar(made.outputs[0])


def where_vector(condition: Value, a: Vector, b: Vector) -> Any:
    """Vector `a` where the condition is 1, `b` where it is 0; both must be finite, for they are blended."""
    return where(condition, a, b)


def vec(x: Value, y: Value, z: Value) -> Vector:
    """Vector from three scalars."""
    if all(isinstance(c, (int, float)) for c in (x, y, z)):
        return Vector(constant=(float(x), float(y), float(z)))
    return Vector(node("ShaderNodeCombineXYZ", {}, {0: x, 1: y, 2: z}).outputs[0])


def components(v: Vector) -> tuple[Any, Any, Any]:
    """The three scalars of a vector."""
    if v.constant is not None:
        return v.constant
    outputs = node("ShaderNodeSeparateXYZ", {}, {0: v}).outputs
    return Scalar(outputs[0]), Scalar(outputs[1]), Scalar(outputs[2])


def scale(v: Vector, factor: Value) -> Vector:
    """Vector times scalar."""
    inputs: dict[int | str, Value] = {0: v, "Scale": factor}
    made = node("ShaderNodeVectorMath", {"operation": "SCALE"}, inputs)
    return Vector(made.outputs["Vector"])


def dot(a: Vector, b: Vector) -> Any:
    """Dot product."""
    return vector_node("DOT_PRODUCT", a, b)


def cross(a: Vector, b: Vector) -> Any:
    """Cross product."""
    return vector_node("CROSS_PRODUCT", a, b)


def length(v: Vector) -> Any:
    """Euclidean length."""
    return vector_node("LENGTH", v)


def normalize(v: Vector) -> Any:
    """Unit vector; the zero vector stays zero."""
    return vector_node("NORMALIZE", v)


def image_tap(image: Any, u: Value, v: Value, interpolation: str, extension: str = "EXTEND") -> tuple[Vector, Scalar]:
    """Colour and alpha of an image at (u, v); interpolation "Closest", "Linear" or "Cubic"; "EXTEND" or "REPEAT"."""
    # Always a node: an image node takes an input without a link as "wherever the object's UVs are".
    at = Vector(node("ShaderNodeCombineXYZ", {}, {0: u, 1: v, 2: 0.0}).outputs[0])
    made = node("ShaderNodeTexImage", {"image": image, "interpolation": interpolation, "extension": extension}, {0: at})
    return Vector(made.outputs["Color"]), Scalar(made.outputs["Alpha"])


def white_noise(vector: Vector, w: Value) -> tuple[Scalar, Scalar, Scalar]:
    """Three independent random numbers in [0, 1], both ends included, from the bits of four floats."""
    made = node("ShaderNodeTexWhiteNoise", {"noise_dimensions": "4D"}, {"Vector": vector, "W": w})
    # The Value output repeats the colour's red: three numbers, not four.
    return components(Vector(made.outputs["Color"]))

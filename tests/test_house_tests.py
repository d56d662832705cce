"""The order of the house of tests: none depends on which others ran, or in what order."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
GENERATORS = {"default_rng", "Generator", "RandomState", "Random", "SystemRandom"}
# Of numpy.random and of random: they keep their state in the module.
LEGACY = {
    "choice", "choices", "gauss", "normal", "permutation", "rand", "randint", "randn", "random", "random_sample",
    "sample", "seed", "shuffle", "standard_normal", "uniform",
}  # fmt: skip


def shared_generators(source: str) -> Iterator[str]:
    """Places of random generators that outlive the test that draws from them."""
    tree = ast.parse(source)
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    modules = {"np.random", "numpy.random", *({"random"} & imported)}
    parents = {child: parent for parent in ast.walk(tree) for child in ast.iter_child_nodes(parent)}
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = ast.unparse(node.func)
        if name.split(".")[-1] in GENERATORS and outlives(node, parents):
            yield f"{node.lineno}: {name}, kept for all tests"
        if name.rpartition(".")[0] in modules and name.split(".")[-1] in LEGACY:
            yield f"{node.lineno}: {name}, of one state for all"


def outlives(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    """Whether it is kept beyond one call: what draws at once, as `default_rng(0).random(9)`, keeps numbers only."""
    if isinstance(parents[node], ast.Attribute):
        return False
    given = isinstance(parents[node], ast.Return | ast.Yield)
    while node in parents:
        child, node = node, parents[node]
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            within = child in node.body if isinstance(node, ast.FunctionDef) else child is node.body
            # A default argument is made once, and what such a fixture gives is for many tests.
            return not within or (given and any(is_kept(decorator) for decorator in decorators(node)))
    return True


def is_kept(decorator: ast.expr) -> bool:
    """Whether what the function gives is given again: a cache, or a fixture of a module or session."""
    return "scope=" in ast.unparse(decorator) or "cache" in ast.unparse(decorator)


def decorators(node: ast.AST) -> list[ast.expr]:
    return getattr(node, "decorator_list", [])


def test_no_test_shares_random_numbers_with_another() -> None:
    """A generator of a module gives each test what the tests before it left: alone it sees other data.

    What `real_blender` holds are programs, each alone in its Blender.
    """
    found = {
        str(path.relative_to(TESTS)): places
        for path in sorted(TESTS.rglob("*.py"))
        if "real_blender" not in path.parts and (places := list(shared_generators(path.read_text(encoding="utf-8"))))
    }
    assert found == {}


@pytest.mark.parametrize(
    "source, count",
    [
        ("RNG = np.random.default_rng(0)", 1),
        ("class A:\n    rng = default_rng(0)", 1),
        ("def f(rng=np.random.default_rng(0)): pass", 1),
        ("@pytest.fixture(scope='module')\ndef rng(): return np.random.default_rng(0)", 1),
        ("@cache\ndef rng(): return np.random.default_rng(0)", 1),
        ("def f(): return np.random.rand(3)", 1),
        ("np.random.seed(0)", 1),
        ("import random\ndef f(): random.shuffle([])", 1),
        ("@cache\ndef data():\n    rng = default_rng(0)\n    return rng.random(3)", 0),
        ("def f(random): return random.normal()", 0),
        ("DATA = np.random.default_rng(0).random(3)", 0),
        ("def f():\n    rng = np.random.default_rng(0)\n    return rng.random(3)", 0),
        ("@pytest.fixture\ndef rng(): return np.random.default_rng(0)", 0),
    ],
)
def test_what_counts_as_shared(source: str, count: int) -> None:
    assert len(list(shared_generators(source))) == count

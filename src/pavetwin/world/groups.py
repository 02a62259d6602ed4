"""Connected groups by union-find."""

from collections.abc import Hashable, Iterable
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)


def groups(chains: Iterable[Iterable[Node]]) -> dict[Node, Node]:
    """Each node → the node that names its connected group; all nodes of one chain are connected."""
    parent: dict[Node, Node] = {}

    def root(node: Node) -> Node:
        while parent.setdefault(node, node) != node:
            parent[node] = node = parent[parent[node]]
        return node

    for first, *others in chains:
        for node in (first, *others):
            parent[root(node)] = root(first)
    return {node: root(node) for node in list(parent)}

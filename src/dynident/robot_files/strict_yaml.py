"""Read YAML as plain data: every scalar stays text, and nothing that hides, repeats or grows is let in."""

from __future__ import annotations

from typing import Any, Final

import yaml

from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place, shown

MAX_BYTES: Final = 1_000_000
MAX_NODES: Final = 20_000
MAX_DEPTH: Final = 16

_NULL: Final = "tag:yaml.org,2002:null"


def load_yaml(path: object, data: bytes) -> tuple[object, dict[str, int]]:
    """Return the one document of a YAML file and the line of each key path (``joints.2.alpha``, counted from 1).

    Scalars are text (``no``, ``1:30`` and ``010`` mean what they say), an empty or ``null`` one is None.

    Raises:
        DescriptionError: No YAML, several documents, anchors or aliases, tags, repeated keys, keys that are no text,
            too large or too deep.
    """
    whole = Place(path)
    if len(data) > MAX_BYTES:
        raise whole.error(f"{len(data)} bytes is no size for a table", f"give a file of up to {MAX_BYTES} bytes")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise whole.error(f"byte {problem.start} is not UTF-8 text", "save the file as UTF-8") from problem
    lines: dict[str, int] = {}
    try:
        node = _StrictLoader(text, path).get_single_node()
        value = None if node is None else _plain(path, node, "", lines)
    except yaml.YAMLError as problem:
        raise _not_yaml(path, problem) from problem
    if value is None:
        raise whole.error("the file is empty", "write a table, or give another file")
    return value, lines


class _StrictLoader(yaml.SafeLoader):
    """The safe loader without anchors, aliases, tags and guessed types, with bounds on size and depth."""

    def __init__(self, text: str, path: object) -> None:
        super().__init__(text)
        self._path, self._nodes, self._depth = path, 0, 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()
        if getattr(event, "anchor", None) is not None:
            raise self._error(event, "anchors (&name) and aliases (*name) are not read", "write the values out")
        if getattr(event, "tag", None) is not None:
            step = "remove it: the meaning follows from the key"
            raise self._error(event, f"the tag {shown(event.tag)} is not read", step)
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise self._error(event, f"more than {MAX_NODES} values", "give a table of one robot")
        if self._depth >= MAX_DEPTH:
            raise self._error(event, f"more than {MAX_DEPTH} levels deep", "give a table of one robot")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def _error(self, event: Any, evidence: str, step: str) -> DescriptionError:
        return Place(self._path, f"line {event.start_mark.line + 1}").error(evidence, step)


# Only null is recognised: the tables that the class would inherit turn 'no' into false and 1:30 into 90.
_StrictLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag == _NULL]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def _plain(path: object, node: yaml.Node, key: str, lines: dict[str, int]) -> object:
    """Return the data of a node and note the line of everything in it."""
    lines[key] = node.start_mark.line + 1
    if isinstance(node, yaml.ScalarNode):
        return None if node.tag == _NULL else node.value
    if isinstance(node, yaml.SequenceNode):
        return [_plain(path, item, _join(key, str(i)), lines) for i, item in enumerate(node.value, start=1)]
    mapping: dict[str, object] = {}
    for name, item in node.value:
        line = name.start_mark.line + 1
        if not isinstance(name, yaml.ScalarNode) or name.tag == _NULL:
            raise Place(path, f"line {line}").error("a key is not a text", "write 'key: value'")
        if name.value in mapping:
            evidence = f"the key {shown(name.value)} is there twice"
            raise Place(path, f"line {line}").error(evidence, "keep one of the two")
        mapping[name.value] = _plain(path, item, _join(key, name.value), lines)
        if mapping[name.value] is None and name.value.isdigit() and not item.value:
            evidence = f"{shown(name.value)} is neither a key nor a value"
            raise Place(path, f"line {line}").error(evidence, "write decimals with a point, such as 5.2")
        lines[_join(key, name.value)] = line  # where the key stands; its value may begin below
    return mapping


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _not_yaml(path: object, problem: yaml.YAMLError) -> DescriptionError:
    mark = getattr(problem, "problem_mark", None)
    reason = getattr(problem, "problem", None) or getattr(problem, "reason", None) or "it cannot be read"
    where = f"line {mark.line + 1}" if mark else ""
    return DescriptionError(path, where, f"not YAML ({reason})", "correct the line; indent with spaces")

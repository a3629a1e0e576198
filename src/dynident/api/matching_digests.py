"""Which compressed logs belong together: digests that are merged, and those of a case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dynident.data.preprocessing import Preprocessing
from dynident.errors import TriangleFileError
from dynident.identification.files.saved_values import model_to_dict
from dynident.identification.streaming.digest import Digest, MergeTree
from dynident.identification.streaming.triangle_file import model_hash, read_digest
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel


def merged_file(paths: Sequence[str | Path]) -> Digest:
    """Return the digest of several files, to the same bits in whatever order they are given.

    Files are merged in the order of the names of their logs.

    Raises:
        TriangleFileError: A log is in two of them, or they are of different models or preparations.
    """
    digests = {str(path): read_digest(path) for path in paths}
    first = digests[str(paths[0])]
    wanted = model_hash(first.model, first.how, first.base.independent.tolist())
    seen: dict[str, str] = {}
    for path in map(str, paths):
        digest = digests[path]
        if model_hash(digest.model, digest.how, digest.base.independent.tolist()) != wanted:
            evidence = f"other than {paths[0]}: {_difference((first.model, first.how), (digest.model, digest.how))}"
            raise TriangleFileError(path, evidence, "reduce all with one case that states the cut-off")
        for chunk in digest.chunks:
            if chunk.sha256 in seen:
                evidence = f"the log {chunk.path} is in {seen[chunk.sha256]} already, so its rows would count twice"
                raise TriangleFileError(path, evidence, "give each log once")
            seen[chunk.sha256] = path
    ordered = sorted(digests.values(), key=lambda digest: [(chunk.path, chunk.sha256) for chunk in digest.chunks])
    tree = MergeTree()
    for position, digest in enumerate(ordered):
        tree.add(position, 1, digest)
    found = tree.merged()
    assert found is not None
    return found


def check_case(digest: Digest, path: str | Path, model: DynamicModel, how: Preprocessing) -> None:
    """Refuse triangles that are not those of a case; a cut-off or delay that it leaves open is that of the triangles.

    Raises:
        TriangleFileError: They are of another model or another preparation.
    """
    independent = base_parameters(model).independent.tolist()
    if how.filter.is_open and (cutoff := digest.how.filter.bandwidth()) is not None:
        how = replace(how, filter=how.filter.with_cutoff(cutoff))
    if how.delay_s is None:
        how = replace(how, delay_s=digest.how.delay_s)
    mine = model_hash(digest.model, digest.how, digest.base.independent.tolist())
    if mine != model_hash(model, how, independent):
        evidence = f"other than the case: {_difference((model, how), (digest.model, digest.how))}"
        raise TriangleFileError(path, evidence, "reduce the logs with this case, or identify with theirs")


def _difference(first: tuple[DynamicModel, Preprocessing], second: tuple[DynamicModel, Preprocessing]) -> str:
    """Return in words what makes two digests impossible to merge."""
    if first[1] != second[1]:
        return f"another preprocessing ({_changed(second[1], first[1])})"
    one, two = model_to_dict(first[0]), model_to_dict(second[0])
    if one["friction"] != two["friction"]:
        return "another friction"
    return f"another robot ('{second[0].robot.name}', here '{first[0].robot.name}')"


def _changed(one: Preprocessing, other: Preprocessing) -> str:
    """Return in words what differs between two preparations."""
    ours, theirs = one.statement(), other.statement()
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    return ", ".join(f"{name} {ours.get(name)}, there {theirs.get(name)}" for name in names) or "its options"

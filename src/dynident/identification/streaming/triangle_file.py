"""The triangle file (.tri): a digest as a NumPy archive of plain arrays, with no pickle; its robot model is JSON.

The array ``about`` holds UTF-8 JSON: kind, format, versions, model and its hash, base parameters, joints,
preprocessing, columns, chunks (path, hash, samples of each log), ``options`` of the command that reduced them and, in a
file of work that was cut short, ``position``.
Joint i has ``columns_i`` (K,), ``factors_i`` (m, K + 1, K + 1), ``sums_i`` (m, K + 1), ``counts_i`` (m,), ``resting_i``
(K + 1, K + 1), ``products_i`` (2, 3, K + 4) and ``rows_i`` (s, K + 1); ``rested`` is (n,). ``states_*`` and
``sampled_*`` are the fields of :class:`States` and :class:`Sampled`.
"""

from __future__ import annotations

import hashlib
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from dynident.arrays import Array, plain
from dynident.data.preprocessing import Preprocessing
from dynident.errors import DynidentError, TriangleFileError
from dynident.file_versions import Document, FileVersions
from dynident.files import unreadable, write_atomically
from dynident.identification.files.saved_values import (
    columns_from_dict,
    model_from_dict,
    model_to_dict,
    preprocessing_from_dict,
    preprocessing_to_dict,
)
from dynident.identification.fit import versions
from dynident.identification.streaming.digest import Chunk, Digest, JointRows, Sampled, States
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel

KIND = "dynident QR factors"

#: What version 1 was called.
OLD_KIND = "dynident triangles"


def _to_2(about: Document) -> Document:
    return {**about, "kind": KIND}


#: Triangle files.
VERSIONS = FileVersions("a file of QR factors", (_to_2,))

#: Bytes that a file may unpack to.
_MOST_BYTES = 1 << 31

_STEP = "give a file that 'dynident reduce' or 'dynident merge' has written"

#: What lets the reading of damaged arrays and values end; the header of an array is a dictionary in Python's words.
_DAMAGE = (
    KeyError, TypeError, ValueError, AttributeError, IndexError, EOFError, RecursionError, SyntaxError, TokenError,
    OverflowError,
)  # fmt: skip

_STATES = ("low", "high", "mean", "spread", "far", "accelerations", "positions", "torques")
_SAMPLED = ("time", "q", "dq", "measured", "unfiltered")


def model_hash(model: DynamicModel, how: Preprocessing, independent: Sequence[int]) -> str:
    """Return what tells triangles that can be merged: the hash of model, base parameters and preprocessing."""
    return _hash((model_to_dict(model), preprocessing_to_dict(how)), independent)


def _hash(parts: tuple[Document, Document], independent: Sequence[int]) -> str:
    data = plain([*parts, [int(k) for k in independent]])
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def write_digest(digest: Digest, path: str | Path, position: Mapping[str, Any] | None = None) -> None:
    """Write a digest; the old file or the new one is there, never half of one.

    Args:
        digest: The digest.
        path: The file.
        position: Where the work stands, for a file from which it goes on.

    Raises:
        FileError: The file cannot be written.
    """
    about = {
        "kind": KIND,
        "format": VERSIONS.current,
        **versions(),
        "hash": model_hash(digest.model, digest.how, digest.base.independent.tolist()),
        **model_to_dict(digest.model),
        "base": list(digest.base.names),
        "joints": list(digest.model.robot.joint_names),
        "preprocessing": preprocessing_to_dict(digest.how),
        "columns": asdict(digest.columns),
        "chunks": [asdict(chunk) for chunk in digest.chunks],
        "states": {"count": digest.states.count, "samples": digest.states.samples},
        "starts": list(digest.sampled.starts),
        "options": dict(digest.options),
        "position": position,
    }
    arrays: dict[str, Any] = {"about": np.frombuffer(json.dumps(plain(about)).encode(), dtype=np.uint8)}
    for i, joint in enumerate(digest.joints):
        for name in ("columns", "factors", "sums", "counts", "resting", "products"):
            arrays[f"{name}_{i}"] = getattr(joint, name)
        arrays[f"rows_{i}"] = digest.sampled.rows[i]
    arrays["rested"] = np.array([joint.rested for joint in digest.joints], dtype=np.int64)
    arrays |= {f"states_{name}": getattr(digest.states, name) for name in _STATES}
    arrays |= {f"sampled_{name}": getattr(digest.sampled, name) for name in _SAMPLED}
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_atomically(path, content.getvalue())


def read_digest(path: str | Path) -> Digest:
    """Read a triangle file.

    Raises:
        FileError: The file cannot be read.
        TriangleFileError: It is no triangle file, damaged, of another format, or of work that was cut short.
    """
    digest, position = read_position(path)
    if position is not None:
        raise TriangleFileError(path, "the work was cut short", "run the same 'dynident reduce' again: it goes on")
    return digest


def read_position(path: str | Path) -> tuple[Digest, Mapping[str, Any] | None]:
    """Read a triangle file and where the work stood; None where it was done. Errors as of :func:`read_digest`."""
    try:
        arrays = _arrays(path)
        about = json.loads(arrays.pop("about").tobytes().decode("utf-8"))
        if about["kind"] not in (KIND, OLD_KIND):
            raise TriangleFileError(path, "no file of QR factors", _STEP)
        hashed = (
            {"robot": about["robot"], "friction": about["friction"]},
            about["preprocessing"],
        )  # as they were written
        about = VERSIONS.migrated(about, lambda evidence, step: TriangleFileError(path, evidence, step))
        return _digest(about, arrays, path, hashed), about["position"]
    except OSError as error:
        raise unreadable(path, error) from error
    except TriangleFileError:
        raise
    except _DAMAGE as error:
        evidence = f"no file of QR factors, or a damaged one ({type(error).__name__}: {error})"
        raise TriangleFileError(path, evidence, _STEP) from error
    except (zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError, MemoryError) as error:
        raise TriangleFileError(path, f"no file of QR factors, or a damaged one ({error})", _STEP) from error
    except DynidentError as error:
        raise TriangleFileError(path, str(error), "compress the logs again (dynident reduce)") from error


def _arrays(path: str | Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > _MOST_BYTES:
            raise TriangleFileError(path, "it unpacks to more than a file of QR factors holds", _STEP)
        found: dict[str, Any] = {}
        for member in members:
            with archive.open(member) as stream:
                values = np.lib.format.read_array(stream, allow_pickle=False)
            found[member.filename.removesuffix(".npy")] = values
        return found


def _digest(
    about: Mapping[str, Any], arrays: Mapping[str, Any], path: str | Path, hashed: tuple[Document, Document]
) -> Digest:
    model, how = model_from_dict(about, path), preprocessing_from_dict(about["preprocessing"])
    width, dof = 3 * model.robot.dof, model.robot.dof
    shapes: dict[str, tuple[int | None, ...]] = {name: (width,) for name in ("low", "high", "mean")}
    shapes |= {"spread": (width, width), "far": (None, width), "accelerations": (dof,)}
    shapes |= {"positions": (2, dof), "torques": (2, dof)}
    states: Any = {name: _array(arrays, f"states_{name}", shape) for name, shape in shapes.items()}
    count = len(arrays["sampled_time"])
    sampled: Any = {
        name: _array(arrays, f"sampled_{name}", (count,) if name == "time" else (count, dof)) for name in _SAMPLED
    }
    chunks = tuple(Chunk(**{**chunk, "steps": tuple(chunk["steps"])}) for chunk in about["chunks"])
    columns = columns_from_dict(about["columns"])
    base = base_parameters(model)
    if _hash(hashed, base.independent.tolist()) != about["hash"]:
        evidence = "its hash is not that of its model; it was changed, or another version chose other base parameters"
        raise TriangleFileError(path, evidence, "compress the logs again (dynident reduce)")
    joints = tuple(_joint(arrays, i, base.count) for i in range(model.robot.dof))
    rows = tuple(_array(arrays, f"rows_{i}", (count, len(joint.columns) + 1)) for i, joint in enumerate(joints))
    return Digest(
        model=model,
        base=base,
        how=how,
        columns=columns,
        joints=joints,
        states=States(count=int(about["states"]["count"]), samples=int(about["states"]["samples"]), **states),
        sampled=Sampled(**sampled, rows=rows, starts=tuple(int(start) for start in about["starts"])),
        chunks=chunks,
        options=_options(about),
    )


def _options(about: Mapping[str, Any]) -> dict[str, str | list[str]]:
    """Return the options that the logs were reduced with; files of older versions state none."""
    options = dict(about.get("options", {}))
    for name, value in options.items():
        if not all(isinstance(text, str) for text in (name, *(value if isinstance(value, list) else [value]))):
            raise ValueError(f"options: {name} is no text")
    return options


def _joint(arrays: Mapping[str, Any], i: int, size: int) -> JointRows:
    columns = np.asarray(arrays[f"columns_{i}"])
    if columns.dtype.kind != "i" or columns.ndim != 1 or np.any((columns < 0) | (columns >= size)):
        raise ValueError(f"columns_{i} are no positions of base parameters")
    wide = len(columns) + 1
    counts = np.asarray(arrays[f"counts_{i}"])
    if counts.dtype.kind != "i" or counts.ndim != 1 or np.any(counts < 0) or int(arrays["rested"][i]) < 0:
        raise ValueError(f"counts_{i} are no numbers of rows")
    return JointRows(
        columns=columns.astype(np.int64),
        factors=_array(arrays, f"factors_{i}", (len(counts), wide, wide)),
        sums=_array(arrays, f"sums_{i}", (len(counts), wide)),
        counts=counts.astype(np.int64),
        resting=_array(arrays, f"resting_{i}", (wide, wide)),
        rested=int(arrays["rested"][i]),
        products=_array(arrays, f"products_{i}", (2, 3, wide + 3)),
    )


def _array(arrays: Mapping[str, Any], name: str, shape: tuple[int | None, ...]) -> Array:
    array = np.asarray(arrays[name])
    fits = array.ndim == len(shape) and all(w in (None, g) for w, g in zip(shape, array.shape, strict=True))
    if array.dtype != np.float64 or not fits or not np.all(np.isfinite(array)):
        raise ValueError(f"{name} is no array of finite numbers of the shape {shape}")
    return array

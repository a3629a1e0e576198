"""Simulink's logs in MATLAB files: structures with time, arrays of structs, and objects that cannot be read."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from dynident.arrays import Array
from dynident.case.case_draft import draft_case
from dynident.data.formats import ColumnMap, read_header, read_log
from dynident.errors import LogFormatError

TIME = np.arange(50) / 100
Q = np.sin(np.outer(TIME, [1.0, 2.0]))
TAU = np.cos(np.outer(TIME, [3.0, 4.0]))


def scope(*labels: str, values: tuple[Array, ...] = (Q, TAU)) -> dict[str, Any]:
    kind = [(name, object) for name in ("values", "dimensions", "label")]
    signals = np.array([(own, 2.0, label) for own, label in zip(values, labels, strict=True)], dtype=kind)
    return {"ScopeData": {"time": TIME[:, None], "signals": signals, "blockName": "model/Scope"}}


def columns(form: str, other: str) -> ColumnMap:
    names = {key: tuple(word.format(k) for k in (1, 2)) for key, word in (("q", form), ("torque", other))}
    return ColumnMap(time="ScopeData.time", **names)  # type: ignore[arg-type]


@pytest.mark.parametrize("compressed", [True, False])
def test_signals_of_a_structure_with_time_have_their_labels(tmp_path: Path, compressed: bool) -> None:
    savemat(tmp_path / "scope.mat", scope("q meas", "<tau>"), do_compression=compressed)
    names = ("ScopeData.time", "ScopeData.q meas1", "ScopeData.q meas2", "ScopeData.tau1", "ScopeData.tau2")
    assert read_header(tmp_path / "scope.mat") == names
    log = read_log(tmp_path / "scope.mat", columns("ScopeData.q meas{}", "ScopeData.tau{}"))
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.torque, TAU)


@pytest.mark.parametrize("labels", [("", ""), ("same", "same"), ("time", "time")])
def test_signals_without_labels_of_their_own_are_numbered(tmp_path: Path, labels: tuple[str, str]) -> None:
    savemat(tmp_path / "scope.mat", scope(*labels))
    log = read_log(tmp_path / "scope.mat", columns("ScopeData.signals(1).values{}", "ScopeData.signals(2).values{}"))
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.torque, TAU)


def test_one_signal_and_signals_by_frame(tmp_path: Path) -> None:
    savemat(tmp_path / "one.mat", scope("q", values=(Q.T[:, None, :],)))  # 2 x 1 x N, as matrices are logged
    assert read_header(tmp_path / "one.mat") == ("ScopeData.time", "ScopeData.q1", "ScopeData.q2")


def test_a_damaged_array_of_structs_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "scope.mat", scope("q", "tau"))
    data = (tmp_path / "scope.mat").read_bytes()
    for cut in range(200, len(data) - 8, 97):
        (tmp_path / "cut.mat").write_bytes(data[:cut])
        with pytest.raises(LogFormatError):
            read_header(tmp_path / "cut.mat")


def opaque(name: str, kind: str) -> bytes:
    """Return a variable that is an object of MATLAB, its content left out."""

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + bytes(-len(content) % 8)

    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + element(14, b""))


def test_objects_are_named_with_the_way_to_export_them(tmp_path: Path) -> None:
    savemat(tmp_path / "empty.mat", {})
    path, head = tmp_path / "set.mat", (tmp_path / "empty.mat").read_bytes()[:128]
    path.write_bytes(head + opaque("logsout", "Simulink.SimulationData.Dataset"))
    with pytest.raises(
        LogFormatError, match=r"logsout \(Simulink.SimulationData.Dataset\); save 'Structure With Time'"
    ):
        read_header(path)
    savemat(tmp_path / "plain.mat", {"t": TIME, "q": Q, "tau": TAU})
    path.write_bytes((tmp_path / "plain.mat").read_bytes() + opaque("x", "timeseries"))
    log = read_log(path)
    np.testing.assert_array_equal(log.q, Q)
    assert any("left out: x (timeseries)" in step for step in log.source.steps)
    remarks = [draft_case("generic-6r", str(file), tmp_path).remarks for file in (path, tmp_path / "plain.mat")]
    assert ["x (timeseries)" in " ".join(own) for own in remarks] == [True, False]


def test_structures_with_time_of_version_7_3(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    for labels in (("q", "tau"), ("", "")):
        with h5py.File(tmp_path / "scope.mat", "w") as file:
            file["ScopeData/time"] = TIME[None, :]
            for name, own in (
                ("values", (Q.T, TAU.T)),
                ("label", [np.frombuffer(x.encode("utf-16-le"), "u2") for x in labels]),
            ):
                for k, one in enumerate(own):
                    file[f"#refs#/{name}{k}"] = one
                refs = np.array([file[f"#refs#/{name}{k}"].ref for k in range(2)], dtype=h5py.ref_dtype)
                file.create_dataset(f"ScopeData/signals/{name}", data=refs[:, None], dtype=h5py.ref_dtype)
        one, other = (
            f"ScopeData.{x}{{}}" if x else f"ScopeData.signals({k}).values{{}}" for k, x in enumerate(labels, 1)
        )
        log = read_log(tmp_path / "scope.mat", columns(one, other))
        np.testing.assert_array_equal(log.q, Q)
        np.testing.assert_array_equal(log.torque, TAU)

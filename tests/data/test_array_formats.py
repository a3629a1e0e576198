"""NumPy archives, Parquet and MATLAB files: round trips, the names of columns, and files that lie."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from dynident.data.formats import (
    ColumnMap,
    Units,
    _arrays,
    npz,
    open_log,
    read_header,
    read_log,
    write_log,
    written_columns,
)
from dynident.data.log import Log
from dynident.errors import LogFormatError

N = 50


def log_of_two_joints() -> Log:
    generator = np.random.default_rng(1)
    time = 0.01 * np.arange(N)
    q, tau = generator.normal(size=(2, N, 2))
    return Log(("a", "b"), time, q, torque=tau)


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
@pytest.mark.parametrize("joints", [1, 3])
def test_a_written_log_reads_back_bit_for_bit(tmp_path: Path, suffix: str, joints: int) -> None:
    generator = np.random.default_rng(joints)
    signals = {name: generator.normal(size=(N, joints)) for name in ("q", "dq", "current", "temperature")}
    log = Log(tuple("abc"[:joints]), np.cumsum(generator.uniform(0.001, 0.01, N)), **signals)
    path = tmp_path / f"run{suffix}"
    write_log(log, path)
    found = read_log(path, written_columns(log))
    assert found.joints == log.joints
    np.testing.assert_array_equal(found.time, log.time)
    assert set(found.signals()) == set(signals)
    for name, values in signals.items():
        np.testing.assert_array_equal(getattr(found, name), values)


def save_mat(path: Path, arrays: dict[str, object], version: str) -> None:
    if version == "7.3":
        import h5py

        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                if isinstance(value, dict):
                    for key, inner in value.items():
                        file.create_dataset(f"{name}/{key}", data=np.atleast_2d(inner).reshape(len(inner), -1).T)
                else:
                    array = np.asarray(value, dtype=float)
                    file.create_dataset(name, data=array.reshape(len(array), -1).T)
            file["elsewhere"] = h5py.ExternalLink("/nowhere.h5", "x")
    else:
        from scipy.io import savemat

        savemat(path, arrays, format=version, oned_as="column")


@pytest.mark.parametrize("version", ["4", "5", "7.3"])
def test_matlab_files_of_every_version(tmp_path: Path, version: str) -> None:
    log = log_of_two_joints()
    path = tmp_path / "run.mat"
    save_mat(path, {"t": log.time, "q": log.q, "tau": log.torque, "gain": np.array([3.0])}, version)
    assert read_header(path) == ("t", "q1", "q2", "tau1", "tau2") or set(read_header(path)) == {
        *("t", "q1", "q2", "tau1", "tau2")
    }
    found = read_log(path)
    np.testing.assert_array_equal(found.q, log.q)
    np.testing.assert_array_equal(found.torque, log.torque)  # type: ignore[arg-type]


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_structs_and_rows_over_time(tmp_path: Path, version: str) -> None:
    log = log_of_two_joints()
    path = tmp_path / "run.mat"
    save_mat(path, {"data": {"t": log.time, "q": np.asarray(log.q)[:, 0]}, "effort": np.asarray(log.torque).T}, version)
    columns = ColumnMap(("a",), time="data.t", q=("data.q",), torque=("effort2",))
    found = read_log(path, columns)
    np.testing.assert_array_equal(found.q[:, 0], log.q[:, 0])
    np.testing.assert_array_equal(found.torque[:, 0], log.torque[:, 1])  # type: ignore[index]


def test_a_list_column_of_parquet_and_timestamps(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    log = log_of_two_joints()
    stamps = pa.array((np.asarray(log.time) * 1e3).round().astype("int64"), pa.timestamp("ms"))
    state = pa.array(np.asarray(log.q).tolist(), pa.list_(pa.float64()))
    effort = pa.array(np.asarray(log.torque).tolist(), pa.list_(pa.float64(), 2))
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"stamp": stamps, "observation.state": state, "effort": effort, "task": ["x"] * N}), path)
    assert read_header(path) == ("stamp", "observation.state1", "observation.state2", "effort1", "effort2")
    found = read_log(
        path,
        ColumnMap(("a", "b"), "stamp", ("observation.state1", "observation.state2"), torque=("effort1", "effort2")),
    )
    np.testing.assert_allclose(found.time, log.time, atol=1e-12)
    np.testing.assert_array_equal(found.q, log.q)
    ragged = pa.array([[1.0, 2.0]] * (N - 1) + [[1.0]])
    pq.write_table(pa.table({"t": log.time, "q": ragged}), path)
    with pytest.raises(LogFormatError, match="row 50: 'q' is not a list of 2 numbers as in row 1"):
        read_log(path, ColumnMap(("a", "b"), torque=()))


def test_a_null_is_named_by_its_row(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "run.parquet"
    values = [float(k) for k in range(N)]
    pq.write_table(pa.table({"t": values, "q1": [*values[:20], None, *values[21:]], "tau1": values}), path)
    with pytest.raises(LogFormatError, match="row 21: column 'q1' holds no number"):
        read_log(path)


def test_units_hold_for_every_format(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, t=10.0 * np.arange(N), q=np.full((N, 1), 180.0) * np.arange(N)[:, None], tau=np.ones((N, 1)))
    found = read_log(path, ColumnMap(units=Units(time="ms", position="deg")))
    np.testing.assert_allclose(found.q[:, 0], np.pi * np.arange(N))
    assert found.time[1] == 0.01
    assert found.source.steps == ("read as NumPy archive", "time from ms; position from deg")


def npz_with(path: Path, header: bytes, body: bytes = b"") -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("q.npy", header + body)


def header_of(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    stream = io.BytesIO()
    npy.write_array_header_1_0(stream, {"shape": shape, "fortran_order": False, "descr": kind})
    return stream.getvalue()


def test_an_archive_that_claims_more_than_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    npz_with(path, header_of((1 << 40, 1 << 20)), b"12345678")
    with pytest.raises(LogFormatError, match="not as many bytes"):
        read_log(path)


def test_python_objects_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, q=np.array([{"a": 1}] * N, dtype=object), allow_pickle=True)
    with pytest.raises(LogFormatError, match="holds Python objects"):
        read_log(path)


def test_arrays_without_a_log(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, gain=np.array(3.0), name=np.array("x"))
    with pytest.raises(LogFormatError, match="no arrays of numbers over time"):
        read_log(path)


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_hdf5_as_python_writes_it(tmp_path: Path, suffix: str) -> None:
    h5py = pytest.importorskip("h5py")
    log, path = log_of_two_joints(), tmp_path / f"run{suffix}"
    with h5py.File(path, "w") as file:
        for name, values in (("t", log.time), ("q", log.q), ("tau", log.torque)):
            file.create_dataset(name, data=values)
        file.create_dataset("images", data=np.zeros((len(log.time), 4, 4)))
    found = read_log(path)
    np.testing.assert_array_equal(found.q, log.q)
    np.testing.assert_array_equal(np.asarray(found.torque), np.asarray(log.torque))


def test_several_recordings_in_one_file_are_not_read_as_columns(tmp_path: Path) -> None:
    """Episodes as arrays (E, N, n) had their times read as columns of joints."""
    log = log_of_two_joints()
    arrays = {"t": log.time, "q": np.asarray(log.q), "tau": np.asarray(log.torque)}
    t, q, tau = (np.stack([values] * 3) for values in arrays.values())
    np.savez(tmp_path / "all.npz", t=t, q=q, tau=tau)
    with pytest.raises(LogFormatError, match=r"several recordings: t, q, tau, \.\.\.; save each"):
        read_log(tmp_path / "all.npz")
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "all.hdf5", "w") as file:
        for group in ("data/demo_0", "data/demo_1"):
            for name, values in arrays.items():
                file.create_dataset(f"{group}/obs/{name}", data=values)
    with pytest.raises(LogFormatError, match=r"several recordings: data\.demo_0\.obs\.q, "):
        read_log(tmp_path / "all.hdf5")


@pytest.mark.parametrize("shape", [(2, 2), (2, 6), (2, 3)], ids=["mass matrix", "Jacobian", "places of the links"])
def test_matrices_of_each_row_beside_a_log_are_no_recordings(tmp_path: Path, shape: tuple[int, int]) -> None:
    log = log_of_two_joints()
    more = np.zeros((len(log.time), *shape))
    np.savez(tmp_path / "run.npz", t=log.time, q=np.asarray(log.q), tau=np.asarray(log.torque), more=more)
    np.testing.assert_array_equal(read_log(tmp_path / "run.npz").q, log.q)


@pytest.mark.parametrize(("limit", "value"), [("MAX_BYTES", 1 << 20), ("MAX_MEMBERS", 1)])
def test_an_archive_that_unpacks_to_more_than_it_should(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int
) -> None:
    np.savez_compressed(tmp_path / "run.npz", t=np.zeros(100_000), q=np.zeros((100_000, 2)))
    assert (tmp_path / "run.npz").stat().st_size < 10_000
    monkeypatch.setattr(npz, limit, value)
    monkeypatch.setattr(npz, "_shape", lambda *_: pytest.fail("it was opened"))
    with pytest.raises(LogFormatError, match="it unpacks to more than a log can hold"):
        read_log(tmp_path / "run.npz", ColumnMap(torque=()))


@pytest.mark.parametrize("rows", [2, 12])
def test_a_log_with_fewer_rows_than_joints_is_not_read_the_other_way(tmp_path: Path, rows: int) -> None:
    q = np.arange(14.0 * rows).reshape(rows, 14)
    np.savez(tmp_path / "run.npz", t=np.arange(float(rows)), q=q, tau=-q)
    table = open_log(tmp_path / "run.npz")
    assert table.header == ("t", *(f"{name}{k}" for name in ("q", "tau") for k in range(1, 15)))
    np.testing.assert_array_equal(table.columns([f"q{k}" for k in range(1, 15)]), q)
    if rows < 10:
        with pytest.raises(LogFormatError, match="only 2 rows; an identification needs seconds of motion"):
            read_log(tmp_path / "run.npz", ColumnMap())


def test_arrays_of_more_cells_than_are_read_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez(tmp_path / "run.npz", t=np.arange(6.0), q=np.ones((6, 2)))
    monkeypatch.setattr(_arrays, "MAX_CELLS", 17)
    with pytest.raises(LogFormatError, match="6 rows of 3 columns, more than are read at once"):
        read_log(tmp_path / "run.npz", ColumnMap(torque=()))


def test_arrays_too_wide_for_signals_are_passed_over(tmp_path: Path) -> None:
    """An image beside the log does not become hundreds of columns."""
    time = np.arange(1000.0)
    np.savez(tmp_path / "run.npz", t=time, q=np.ones((1000, 256)), image=np.ones((1000, 257)))
    header = read_header(tmp_path / "run.npz")
    assert len(header) == 257 and not any("image" in name for name in header)

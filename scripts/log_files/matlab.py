"""MAT files: version 5 by scipy, 7.3 by h5py as MATLAB lays it out."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from scipy.io import loadmat, savemat

N = 25


def signals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(N) * 0.02
    return t, np.sign(np.sin(9 * t)), np.column_stack([np.sin(t), np.cos(3 * t)])


def write(folder: Path) -> None:
    t, u, y = signals()
    plain = {"time": t.reshape(-1, 1), "u": u.reshape(1, -1), "y": y, "count": np.arange(N, dtype=np.int16).reshape(-1, 1), "title": "a run", "gain": 3.0}
    savemat(folder / "columns.mat", plain, do_compression=False)
    # As Simulink's "Structure With Time" saves it, and a struct of arrays with a time of its own.
    first = {"values": u.reshape(-1, 1), "dimensions": 1.0, "label": "u", "blockName": "model/u"}
    second = {"values": y, "dimensions": 2.0, "label": "angle", "blockName": "model/Scope"}
    both = np.empty(2, dtype=object)
    both[:] = [first, second]
    record = np.zeros(2, dtype=[("values", object), ("dimensions", object), ("label", object), ("blockName", object)])
    for i, one in enumerate(both):
        for key, value in one.items():
            record[i][key] = value
    simulink = {"out": {"time": t.reshape(-1, 1), "signals": record, "blockName": "model"}, "imu": {"t": (t[::2] + 0.001).reshape(-1, 1), "gyro": y[::2], "ok": np.ones(13, dtype=bool)}}
    savemat(folder / "simulink.mat", simulink, do_compression=True)
    path = folder / "v73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value, kind in [("time", t.reshape(1, -1), b"double"), ("u", u.reshape(1, -1), b"double"), ("y", y.T, b"double")]:
            set_ = file.create_dataset(name, data=value, compression="gzip" if name == "y" else None)
            set_.attrs["MATLAB_class"] = np.bytes_(kind)
        group = file.create_group("imu")
        group.attrs["MATLAB_class"] = np.bytes_(b"struct")
        group.create_dataset("time", data=(t[::2] + 0.001).reshape(1, -1)).attrs["MATLAB_class"] = np.bytes_(b"double")
        group.create_dataset("gyro", data=y[::2].T.astype(np.float32), chunks=(2, 5), compression="gzip", shuffle=True).attrs["MATLAB_class"] = np.bytes_(b"single")
    with path.open("r+b") as file:
        text = b"MATLAB 7.3 MAT-file, made by h5py"
        file.write(text.ljust(124) + b"\x00\x02IM")


def columns(values: np.ndarray, name: str) -> dict[str, list[float]]:
    values = np.asarray(values, dtype=float)
    values = values if values.ndim == 2 and values.shape[1] != 1 and values.shape[0] != 1 else values.reshape(-1, 1)
    many = values.shape[1] > 1
    return {f"{name}[{j}]" if many else name: values[:, j].tolist() for j in range(values.shape[1])}


def read(folder: Path) -> dict[str, object]:
    m = loadmat(folder / "columns.mat")
    plain = {**columns(m["u"], "u"), **columns(m["y"], "y"), **columns(m["count"], "count")}
    s = loadmat(folder / "simulink.mat", squeeze_me=False, struct_as_record=False)
    out, imu = s["out"][0, 0], s["imu"][0, 0]
    signals: dict[str, list[float]] = {}
    for one in out.signals.ravel():
        signals.update(columns(one.values, str(one.label[0])))
    with h5py.File(folder / "v73.mat") as file:
        v73 = {
            "": {"time": file["time"][0].tolist(), "channels": {**columns(file["u"][:].T, "u"), **columns(file["y"][:].T, "y")}},
            "imu": {"time": file["imu/time"][0].tolist(), "channels": columns(file["imu/gyro"][:].T, "gyro")},
        }
    return {
        "columns.mat": {"": {"time": m["time"].ravel().tolist(), "channels": plain}},
        "simulink.mat": {
            "out": {"time": out.time.ravel().tolist(), "channels": signals},
            "imu": {"time": imu.t.ravel().tolist(), "channels": {**columns(imu.gyro, "gyro"), **columns(imu.ok, "ok")}},
        },
        "v73.mat": v73,
    }

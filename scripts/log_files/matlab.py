"""MAT files: version 5 by scipy, 7.3 by h5py as MATLAB lays it out; objects, cells and arrays of structs by mat-io in both versions.

mat-io knows no timeseries and no Dataset of Simulink: their properties have the names that MATLAB gives them. timetable, table, datetime and duration are its own.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from matio import load_from_mat, save_to_mat
from matio.utils.matclass import MatlabOpaque
from scipy.io import loadmat, savemat

N = 25
DATASET = "Simulink.SimulationData.Dataset"
RAM = "Simulink.SimulationData.Storage.RamDatasetStorage"


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


    objects = matlab_objects()
    structs = matlab_structs()
    stamps = {"time": STAMPS_US, "u": u.reshape(-1, 1), "y": y}
    for version, end in [("v7", ""), ("v7.3", "_v73")]:
        save_to_mat(folder / f"objects{end}.mat", objects, version=version, saveobj_classes=[DATASET, RAM])
        save_to_mat(folder / f"structs{end}.mat", structs, version=version)
        save_to_mat(folder / f"stamps_us{end}.mat", stamps, version=version)
    # Version 6 is 7 without compression.
    save_to_mat(folder / "objects_v6.mat", objects, version="v7", saveobj_classes=[DATASET, RAM], do_compression=False)


# Microseconds since 1970, as autopilots and computers log them.
STAMPS_US = (1_700_000_000_123_457 + 10_000 * np.arange(N, dtype=np.int64)).reshape(-1, 1)


EMPTY = np.empty((0, 0))


def series(data: np.ndarray, time: np.ndarray | None = None, even: tuple[float, float] | None = None, name: str = "unnamed", units: str = "seconds", streamed: bool = False) -> MatlabOpaque:
    """A timeseries as R2019a writes it; start and step tell an even time. Simulink keeps what it wrote while it ran in a storage of its own, time in the last dimension."""
    rows = len(time) if time is not None else data.shape[0]
    start, step = even or (EMPTY, EMPTY)
    info = {"Units": units, "Format": "", "StartDate": "", "Length": 0.0 if streamed else float(rows), "Time_": EMPTY if time is None else time.reshape(-1, 1), "Increment_": step, "Start_": start}
    storage = {"IsTimeStorageFirst": np.bool_(False), "Data": data.T, "SampleDimensions": float(data.shape[1])}
    properties = {
        "Name": name,
        "Data_": EMPTY if streamed else data,
        "Time_": EMPTY,
        "TimeInfo": MatlabOpaque(properties=info, classname="tsdata.timemetadata"),
        "DataInfo": MatlabOpaque(properties={"Units": "V"}, classname="tsdata.datametadata"),
        "IsTimeFirst_": np.bool_(data.ndim < 3),
        "Storage_": MatlabOpaque(properties=storage, classname="tsdata.StreamingStorage") if streamed else EMPTY,
    }
    return MatlabOpaque(properties=properties, classname="timeseries")


def cells(*elements: object) -> np.ndarray:
    found = np.empty((1, len(elements)), dtype=object)
    for i, element in enumerate(elements):
        found[0, i] = element
    return found


def saved(classname: str, **fields: object) -> MatlabOpaque:
    """An object that saves a struct instead of its properties."""
    struct = np.empty((1, 1), dtype=[(name, object) for name in fields])
    struct[0, 0] = tuple(fields.values())
    return MatlabOpaque(properties={"any": struct}, classname=classname)


def matlab_objects() -> dict[str, object]:
    t, u, y = signals()
    speed = series(u.reshape(-1, 1), time=t + 0.001 * np.sin(t))
    even = series(y.astype(np.float32), even=(0.5, 0.01), name="Attitude")
    last = series(np.stack([y, 2 * y, 3 * y], axis=0).transpose(2, 0, 1), time=np.arange(N) * 20.0, units="milliseconds")
    streamed = series(y, time=t**2, streamed=True)
    one = np.empty((1, 1), dtype=[("y", object), ("tout", object)])
    one[0, 0] = (series(u.reshape(-1, 1), time=t), t.reshape(-1, 1))

    def signal(name: str, values: object) -> MatlabOpaque:
        return MatlabOpaque(properties={"Name": name, "Values": values, "PortType": "outport"}, classname="Simulink.SimulationData.Signal")

    # mat-io finds objects within objects in arrays of structs, not in dictionaries.
    bus = np.empty((1, 1), dtype=[("roll", object), ("pitch", object)])
    bus[0, 0] = tuple(series(sign * u.reshape(-1, 1), even=(0.0, 0.02), name=name) for sign, name in [(1, "roll"), (-1, "pitch")])
    elements = cells(signal("rudder", series(u.reshape(-1, 1), time=t)), signal("", series(y, even=(0.0, 0.05))), signal("bus", bus))
    storage = saved(RAM, Version=2.0, Elements=elements)
    frame = pd.DataFrame({"force": u, "angle": y[:, 0], "word": ["a"] * N})
    timed = frame[["force", "angle"]].set_index(pd.to_timedelta(np.arange(N) * 8, unit="ms"))
    dated = frame[["force", "angle"]].set_index(pd.DatetimeIndex(np.datetime64("2024-03-01T12:30:00.250") + np.arange(N) * np.timedelta64(40, "ms")))
    return {
        "speed": speed,
        "again": speed,
        "even": even,
        "last": last,
        "run": {"gain": 2.0, "u": series(u.reshape(-1, 1), time=t), "inner": {"y": series(y, time=t + 0.5)}},
        "runs": cells(series(u.reshape(-1, 1), time=t), {"time": t.reshape(-1, 1), "v": y[:, :1]}, "a word"),
        "logsout": saved(DATASET, Name="logsout", Version=3.0, Storage=storage),
        "out": MatlabOpaque(properties={"Data": one, "Metadata": MatlabOpaque(properties={"UserString": ""}, classname="Simulink.SimulationMetadata")}, classname="Simulink.SimulationOutput"),
        "streamed": streamed,
        "timed": timed,
        "dated": dated,
        "plain": frame.assign(time=t),
    }


def matlab_structs() -> dict[str, object]:
    """Arrays of structs and cells of structs, without objects."""
    t, u, y = signals()
    trials = np.empty((1, 3), dtype=[("name", object), ("time", object), ("u", object), ("imu", object)])
    for i in range(3):
        trials[0, i]["name"] = f"trial {i + 1}"
        trials[0, i]["time"] = (t[i:] * (i + 1)).reshape(-1, 1)
        trials[0, i]["u"] = u[i:].reshape(-1, 1)
        trials[0, i]["imu"] = {"t": t[: 10 + i].reshape(-1, 1), "gyro": y[: 10 + i].astype(np.float32)}
    flights = cells({"time": t.reshape(-1, 1), "u": u.reshape(-1, 1)}, cells({"t": t[:9].reshape(-1, 1), "y": y[:9]}), np.empty((0, 0)), np.empty((0, 0)))
    return {"trials": trials, "flights": flights, "empty": np.empty((0, 0))}


def columns(values: np.ndarray, name: str) -> dict[str, list[float]]:
    values = np.asarray(values, dtype=float)
    values = values if values.ndim == 2 and values.shape[1] != 1 and values.shape[0] != 1 else values.reshape(-1, 1)
    many = values.shape[1] > 1
    return {f"{name}[{j}]" if many else name: values[:, j].tolist() for j in range(values.shape[1])}


def topic(time: np.ndarray, **channels: np.ndarray) -> dict[str, object]:
    found: dict[str, list[float]] = {}
    for name, values in channels.items():
        found.update(columns(values, name))
    return {"time": np.asarray(time, dtype=float).ravel().tolist(), "channels": found}


def of_series(ts: MatlabOpaque, name: str) -> dict[str, object]:
    """What a timeseries holds, by its properties as mat-io reads them."""
    p, info = ts.properties, ts.properties["TimeInfo"].properties
    time = info["Time_"].ravel() if info["Time_"].size else info["Start_"].item() + info["Increment_"].item() * np.arange(int(info["Length"].item()))
    if info["Units"].item() == "milliseconds":
        time = time / 1000
    data = p["Data_"] if p["Data_"].size else p["Storage_"].properties["Data"].T
    if not p["IsTimeFirst_"].item():
        data = data.reshape((-1, len(time)), order="F").T
    return topic(time, **{name if p["Name"].item() == "unnamed" else p["Name"].item(): data})


def of_frame(frame: pd.DataFrame) -> dict[str, object]:
    time = (frame.index - frame.index[0]) / pd.Timedelta(seconds=1)
    return topic(time.to_numpy(), **{name: frame[name].to_numpy() for name in frame.columns})


def read_objects(path: Path) -> dict[str, object]:
    m = load_from_mat(path)
    run, runs = m["run"][0, 0], m["runs"]
    elements = m["logsout"].properties["any"][0, 0]["Storage"].properties["any"][0, 0]["Elements"]
    rudder, nameless, bus = (e.properties["Values"] for e in elements.ravel())
    plain = m["plain"]
    return {
        **{name: of_series(m[name], name) for name in ["speed", "again", "even", "last"]},
        "run.u": of_series(run["u"], "u"),
        "run.inner.y": of_series(run["inner"][0, 0]["y"], "y"),
        "runs[1]": of_series(runs[0, 0], "runs[1]"),
        "runs[2]": topic(runs[0, 1][0, 0]["time"], v=runs[0, 1][0, 0]["v"]),
        "logsout.rudder": of_series(rudder, "rudder"),
        "logsout.element[2]": of_series(nameless, "element[2]"),
        "logsout.bus.roll": of_series(bus[0, 0]["roll"], "roll"),
        "logsout.bus.pitch": of_series(bus[0, 0]["pitch"], "pitch"),
        "out.y": of_series(m["out"].properties["Data"][0, 0]["y"], "y"),
        "streamed": of_series(m["streamed"], "streamed"),
        "timed": of_frame(m["timed"]),
        "dated": of_frame(m["dated"]),
        "plain": topic(plain["time"].to_numpy(), force=plain["force"].to_numpy(), angle=plain["angle"].to_numpy()),
    }


def read_structs(path: Path) -> dict[str, object]:
    m = load_from_mat(path)
    found: dict[str, object] = {}
    for i, trial in enumerate(m["trials"].ravel()):
        found[f"trials[{i + 1}]"] = topic(trial["time"], u=trial["u"])
        imu = trial["imu"][0, 0]
        found[f"trials[{i + 1}].imu"] = topic(imu["t"], gyro=imu["gyro"])
    first, second = m["flights"].ravel()[:2]
    found["flights[1]"] = topic(first[0, 0]["time"], u=first[0, 0]["u"])
    found["flights[2][1]"] = topic(second[0, 0][0, 0]["t"], y=second[0, 0][0, 0]["y"])
    return found


def read_stamps(time: np.ndarray, u: np.ndarray, y: np.ndarray) -> dict[str, object]:
    time = time.astype(np.int64).ravel()
    return {"": topic((time - time[0]) / 1e6, u=u, y=y)}


def read(folder: Path) -> dict[str, object]:
    stamps = loadmat(folder / "stamps_us.mat")
    with h5py.File(folder / "stamps_us_v73.mat") as file:
        stamps_v73 = read_stamps(file["time"][:].T, file["u"][:].T, file["y"][:].T)
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
        "objects.mat": read_objects(folder / "objects.mat"),
        "objects_v6.mat": read_objects(folder / "objects_v6.mat"),
        "objects_v73.mat": read_objects(folder / "objects_v73.mat"),
        "structs.mat": read_structs(folder / "structs.mat"),
        "structs_v73.mat": read_structs(folder / "structs_v73.mat"),
        "stamps_us.mat": read_stamps(stamps["time"], stamps["u"], stamps["y"]),
        "stamps_us_v73.mat": stamps_v73,
    }

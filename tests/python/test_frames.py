"""Frames, tables, dicts and structured arrays as logs, and logs as frames."""

from __future__ import annotations

import json
import pickle
from datetime import datetime, timedelta, timezone
from decimal import Decimal
from pathlib import Path

import numpy
import pandas
import polars
import pyarrow
import pytest

import deadtime
from deadtime import errors

TIME = numpy.arange(6) * 0.5
U = numpy.array([0.0, 1.0, 1.0, 0.0, -1.0, 0.0])


def test_every_kind_of_table_gives_the_same_log() -> None:
    columns = {"time": TIME, "u [V]": U, "y": U + 1}
    structured = numpy.zeros(6, dtype=[("time", "f8"), ("u [V]", "f4"), ("y", "f8")])
    for name, values in columns.items():
        structured[name] = values
    polar = polars.DataFrame(columns)
    tables = [columns, pandas.DataFrame(columns), polar, polar.lazy(), pyarrow.table(columns), structured, {k: list(v) for k, v in columns.items()}]
    wanted = deadtime.Log(TIME, {"u": U, "y": U + 1}, {"u": "V"})
    for table in tables:
        log = deadtime.as_log(table)
        assert log.channels == ["u", "y"] and log.units == {"u": "V"}, type(table)
        for name in ("u", "y"):
            assert numpy.array_equal(log[name], wanted[name]), type(table)
        assert numpy.array_equal(log.time, TIME)


def test_dates_are_counted_from_the_first_stamp_to_the_nanosecond() -> None:
    start = numpy.datetime64("2024-02-29T23:59:59.123456789", "ns")
    stamps = start + (numpy.arange(6) * 1_000_001).astype("timedelta64[ns]")
    wanted = numpy.arange(6) * 1_000_001e-9
    frames = [
        pandas.DataFrame({"time": stamps, "u": U}),
        pandas.DataFrame({"u": U}, index=pandas.DatetimeIndex(stamps)),
        pandas.DataFrame({"u": U}, index=pandas.DatetimeIndex(stamps).tz_localize("Europe/Berlin")),
        pandas.DataFrame({"time": pandas.Series(stamps).dt.tz_localize("UTC"), "u": U}),
        polars.DataFrame({"time": stamps, "u": U}),
        pyarrow.table({"time": stamps, "u": U}),
        pandas.DataFrame({"u": U}, index=pandas.TimedeltaIndex(stamps - start)),
        {"time": stamps, "u": U},
    ]
    for frame in frames:
        assert numpy.allclose(deadtime.as_log(frame).time, wanted, rtol=0, atol=1e-15), type(frame)
    for kind in (datetime(2024, 1, 1), datetime(2024, 1, 1, tzinfo=timezone.utc)):
        log = deadtime.as_log({"time": [kind + timedelta(seconds=0.5 * k) for k in range(6)], "u": U})
        assert numpy.allclose(log.time, TIME, rtol=0, atol=1e-12)


def test_a_pandas_index_called_time_is_the_time() -> None:
    frame = pandas.DataFrame({"u": U}, index=pandas.Index(TIME, name="time"))
    assert numpy.array_equal(deadtime.as_log(frame).time, TIME)
    with pytest.raises(errors.LogError, match="no column is called `time`"):
        deadtime.as_log(pandas.DataFrame({"u": U}))


def test_missing_samples_of_every_kind_are_missing() -> None:
    wanted = [0.0, numpy.nan, 2.0, 3.0, numpy.nan, 5.0]
    there = [0, None, 2, 3, None, 5]
    columns = {
        "nan": wanted,
        "object": there,
        "Int64": pandas.array(there, dtype="Int64"),
        "Float32": pandas.array(there, dtype="Float32"),
        "arrow": pandas.array(there, dtype="int64[pyarrow]"),
        "decimal": [None if v is None else Decimal(v) for v in there],
    }
    frame = pandas.DataFrame({"time": TIME} | columns)
    log = deadtime.as_log(frame)
    for name in columns:
        assert numpy.array_equal(log[name], wanted, equal_nan=True), name
    for table in (polars.DataFrame({"time": TIME, "y": there}), pyarrow.table({"time": TIME, "y": there})):
        assert numpy.array_equal(deadtime.as_log(table)["y"], wanted, equal_nan=True)
    masked = numpy.ma.masked_invalid(wanted)
    assert numpy.array_equal(deadtime.as_log({"time": TIME, "y": masked})["y"], wanted, equal_nan=True)


def test_booleans_and_integers_are_numbers() -> None:
    frame = pandas.DataFrame({"time": TIME, "on": U > 0, "nullable": pandas.array(U > 0, dtype="boolean"), "count": numpy.arange(6, dtype="uint8")})
    log = deadtime.as_log(frame)
    assert numpy.array_equal(log["on"], U > 0) and numpy.array_equal(log["nullable"], U > 0)
    assert numpy.array_equal(log["count"], numpy.arange(6))
    assert numpy.array_equal(deadtime.as_log(polars.DataFrame({"time": TIME, "on": U > 0}))["on"], U > 0)


@pytest.mark.parametrize("make", [pandas.DataFrame, polars.DataFrame, pyarrow.table, dict])
def test_a_column_that_is_no_number_is_left_out_and_asking_for_it_is_told_why(make: type) -> None:
    frame = make({"time": TIME, "u": U, "mode": ["hover"] * 6})
    log = deadtime.as_log(frame)
    assert log.channels == ["u"]
    with pytest.raises(errors.LogError, match="sample 0: channel `mode` holds `hover`, which is no number"):
        deadtime.estimate(frame, "mode", "u")


def test_the_first_stray_cell_is_named() -> None:
    log = deadtime.as_log(pandas.DataFrame({"time": TIME, "u": U, "y": [1, 2, "off", 4, 5, 6]}))
    with pytest.raises(errors.LogError, match="sample 2: channel `y` holds `off`"):
        deadtime.estimate_impulse_response(log, "u", "y")


def test_names_that_repeat_are_refused() -> None:
    twice = pandas.DataFrame(numpy.column_stack([TIME, U, U]), columns=["time", "u", "u"])
    with pytest.raises(errors.LogError, match="two columns are called `u`"):
        deadtime.as_log(twice)
    with pytest.raises(errors.LogError, match="two columns are called `u`"):
        deadtime.as_log({"time": TIME, "u": U, "u [V]": U})
    with pytest.raises(errors.LogError, match="two columns are called `time`"):
        deadtime.as_log({"time": TIME, "time [s]": TIME, "u": U})


def test_time_that_cannot_be_is_refused_with_the_sample_and_the_remedy() -> None:
    back = TIME[[0, 1, 3, 2, 4, 5]]
    with pytest.raises(errors.LogError, match=r"sample 3: channel `time` runs back from 1.5 s to 1 s; sort the samples"):
        deadtime.as_log(pandas.DataFrame({"time": back, "u": U}))
    with pytest.raises(errors.LogError, match="sample 1: channel `time` stands still"):
        deadtime.as_log({"time": TIME * 0, "u": U})
    with pytest.raises(errors.LogError, match="sample 2: channel `time` holds `NaN`"):
        deadtime.as_log({"time": numpy.where(TIME == 1.0, numpy.nan, TIME), "u": U})
    with pytest.raises(errors.LogError, match="sample 1: channel `time` holds `NaN`"):
        deadtime.as_log(pandas.DataFrame({"time": pandas.to_datetime(["2024-01-01", None]), "u": [1.0, 2.0]}))
    with pytest.raises(errors.LogError, match="`time` holds `noon`"):
        deadtime.as_log({"time": ["noon"] * 6, "u": U})
    with pytest.raises(errors.LogError, match="time is in `ms`"):
        deadtime.as_log({"time [ms]": TIME, "u": U})
    with pytest.raises(errors.LogError, match="no samples"):
        deadtime.as_log({"time": [], "u": []})


def test_messages_about_logs_in_memory_speak_of_samples_and_of_files_of_rows(tmp_path: Path) -> None:
    y = numpy.where(TIME == 1.0, numpy.nan, U)
    frame = deadtime.as_log({"time": TIME, "u": y, "y": U})
    with pytest.raises(errors.LogError, match="frame, sample 2: input `u` has no sample at 1 s"):
        deadtime.estimate(frame, "u", "y")
    with pytest.raises(errors.LogError, match="frame, sample 2: input `u` has no sample"):
        deadtime.estimate(frame, "u", "y", window=(0.5, None))
    frame.write_csv(tmp_path / "log.csv")
    with pytest.raises(errors.LogError, match="row 4: input `u` has no sample at 1 s"):
        deadtime.estimate(tmp_path / "log.csv", "u", "y")
    with pytest.raises(errors.LogError, match="sample 1: channel `u` holds `inf`"):
        deadtime.Log([0.0, 1.0], {"u": [0.0, numpy.inf]})


def test_what_is_no_log_is_refused() -> None:
    for wrong in (3, 3.5, numpy.zeros(4), None):
        with pytest.raises(TypeError, match="a log is a deadtime.Log"):
            deadtime.as_logs(wrong)
    with pytest.raises(errors.LogError, match="has 2 samples where time has 6"):
        deadtime.as_log({"time": TIME, "u": [1.0, 2.0]})


def test_several_logs_may_be_of_different_kinds(examples: Path) -> None:
    logs = deadtime.as_logs([examples / "uav_flight.csv", {"time": TIME, "u": U}])
    assert [len(log) for log in logs] == [1500, 6]
    assert len(deadtime.as_logs({"time": TIME, "u": U})) == 1


@pytest.mark.parametrize("headers", [False, True])
def test_a_log_becomes_a_frame_and_a_log_again(headers: bool) -> None:
    y = numpy.where(TIME == 1.0, numpy.nan, U)
    log = deadtime.Log(TIME, {"u": U, "y": y}, {"u": "m/s"}, source="frame")
    frame = log.to_pandas(headers=headers)
    assert list(frame.columns) == ["time", "u [m/s]" if headers else "u", "y"]
    assert deadtime.as_log(frame) == log
    polar = log.to_polars(headers=headers)
    assert polar["y"].null_count() == 1
    assert deadtime.as_log(polar, units={"u": "m/s"}) == log
    assert pickle.loads(pickle.dumps(log)) == log


def test_a_notebook_shows_channels_units_and_gaps() -> None:
    log = deadtime.Log(TIME, {"u<1>": U, "y": numpy.where(TIME == 1.0, numpy.nan, U)}, {"y": "m/s"})
    page = log._repr_html_()
    assert "u&lt;1&gt;" in page and "<td>m/s</td>" in page and "<td>1</td>" in page


def test_channels_are_calculated_from_others(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text("time,run,vx [m/s],vy [m/s]\n" + "".join(f"{0.1 * k:.1f},{k // 3},{k},{2 * k}\n" for k in range(6)))
    log = deadtime.read(path, channels={"speed [m/s]": "hypot(vx,vy)", "twice": "2*speed"})
    numpy.testing.assert_allclose(log["speed"], numpy.hypot(log["vx"], log["vy"]), rtol=1e-15)
    numpy.testing.assert_allclose(log["twice"], 2 * log["speed"], rtol=1e-15)
    assert log.units["speed"] == "m/s" and "twice" not in log.units
    runs = deadtime.read_records(path, "run", channels={"sum": "vx + vy"})
    assert [run["sum"].tolist() for run in runs] == [[0.0, 3.0, 6.0], [9.0, 12.0, 15.0]]
    missing = deadtime.Log(TIME, {"u": U, "y": numpy.where(TIME > 1, U, numpy.nan)}).with_channels({"ratio": "u/y"})
    assert numpy.isnan(missing["ratio"][[0, 3, 5]]).all() and missing["ratio"][4] == 1.0
    for channels, says in (({"s": "hypot(vx)"}, "2 arguments"), ({"s": "vz"}, "vz"), ({"vx": "vy"}, "vx"), ({"s": ""}, "NAME=EXPRESSION")):
        with pytest.raises(errors.LogError, match=says):
            deadtime.read(path, channels=channels)


def test_the_clock_of_a_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text("u,stamp,run\n1,1000,a\n2,1040,a\n3,1080,b\n")
    log = deadtime.read(path, time="stamp", time_unit="ms")
    numpy.testing.assert_allclose(numpy.diff(log.time), 0.04, rtol=1e-12)
    assert log.channels[0] == "u"
    assert [len(run) for run in deadtime.read_records(path, "run", time="stamp", time_unit="us")] == [2, 1]
    listed = deadtime.listing(path, time="stamp", time_unit="ms")
    assert listed["format"] == "deadtime/log@1" and listed["topics"][0]["step_s"] == pytest.approx(0.04)
    hours = deadtime.read(path, time="stamp", time_unit="h")
    assert hours.time[-1] - hours.time[0] == pytest.approx(80 * 3600)
    with pytest.raises(ValueError, match="one of s, ms, us, ns"):
        deadtime.read(path, time="stamp", time_unit="weeks")  # type: ignore[arg-type]
    with pytest.raises(errors.LogError, match="stmp"):
        deadtime.read(path, time="stmp")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_bag_has_two_clocks(root: Path) -> None:
    bag = root / "golden" / "log_files" / "ros2_zstd.mcap"
    topics = [topic for topic in deadtime.listing(bag)["topics"] if any("position" in c["name"] for c in topic["channels"])]
    name = next(c["short"] for c in topics[0]["channels"] if "position" in c["name"])
    arrived, sent = (deadtime.read(bag, outputs=[name], stamps=stamps).time for stamps in ("arrival", "header"))
    # scripts/log_files: states are sent 3 ms before the commands' stamps and recorded 1 ms behind them.
    numpy.testing.assert_allclose((arrived - sent)[:5], 0.004, atol=1e-6)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_file_of_several_topics_is_asked_for_channels(root: Path) -> None:
    flight = root / "golden" / "log_files" / "flight.ulg"
    with pytest.raises(errors.LogError, match="topics"):
        deadtime.read(flight)
    log = deadtime.read(flight, inputs=["thrust"], outputs=["points[0].x"])
    assert log.channels == ["thrust", "points[0].x"]
    # What pyulog reads.
    read = json.loads((root / "golden" / "log_files" / "expected.json").read_text())["flight.ulg"]["actuator"]["channels"]["thrust"]
    assert len(log) > 3 and set(log["thrust"].tolist()) <= set(read)

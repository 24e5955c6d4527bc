"""Studies, plans and the gate, from Python."""

from __future__ import annotations

import csv
import json
import pickle
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from interrupts import interrupted

import deadtime
from deadtime import Plan
from deadtime.errors import FileError, RegistryError, StudyError

SMALL = """
format = "deadtime/plan@1"
name = "small"
about = "A small plan."
seed = 3
trials = 60
samples = 200
max_delay = 20
plant = ["slow2", "fast1"]
excitation = ["rbs"]
snr = [100, "inf"]
delay_s = [4, { uniform_s = [2, 9] }]
method = ["arxstruc", "oestruc nf=1", "crosscorr"]
[scoring]
kept_percent = [100, 90]
[[aims]]
aim = "nobody is wrong by a thousand samples"
cells = { snr = 100 }
method = ["arxstruc"]
measure = "rms_samples"
at_most = 1000
[[published]]
source = "nowhere"
cells = { plant = "fast1", method = "crosscorr", snr = 100 }
statistic = "rms_samples"
value = 1e9
"""
KEYS = {
    "format": "deadtime/plan@1",
    "name": "keys",
    "plant": "fast1",
    "excitation": "rbs",
    "snr": np.array([10.0, np.inf]),
    "delay_s": [3.0, {"uniform_s": (1.0, 2.0)}],
    "samples": np.int64(150),
    "method": ("arxstruc",),
    "trials": 5,
}
TIME = "time_per_estimate_s"


def results(study: deadtime.Study) -> dict:
    """A study without its run times, which are no part of the result."""
    whole = study.to_dict()
    for cell in whole["cells"]:
        cell[TIME] = None
    return whole


def equal(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    """The same estimates to the bit, run times apart."""
    bits = [n for n in a if n != "time_s"]
    return list(a) == list(b) and all(np.array_equal(a[n], b[n], equal_nan=a[n].dtype.kind == "f") for n in bits)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> deadtime.Study:
    return deadtime.study(SMALL, tmp_path_factory.mktemp("small") / "out")


def test_plans_come_from_names_files_texts_and_dicts(tmp_path):
    assert "thesis" in deadtime.plans() and "fast1" in deadtime.plants()
    assert all(Plan(name).name == name for name in deadtime.plans())
    (tmp_path / "small.toml").write_text(SMALL)
    text = Plan(SMALL, tmp_path)
    assert Plan(str(tmp_path / "small.toml")) == Plan(tmp_path / "small.toml") == Plan(text) == Plan(text.to_toml(), tmp_path) == text
    text.save(tmp_path / "again.toml")
    assert Plan(tmp_path / "again.toml") == text
    keys = deadtime.studies.as_plan(KEYS)
    assert keys.trials == {"keys": 5} and keys.estimates == 2 * 2 * 5 and keys.seed == 1
    assert deadtime.studies.as_plan("thesis", trials=7, seed=2).seed == 2


def test_a_plan_says_what_it_is_and_what_it_costs():
    plan = Plan(SMALL)
    assert (plan.estimates, plan.methods, plan.grids) == (2 * 2 * 2 * 60 * 3, ["arxstruc", "oestruc nf=1", "crosscorr"], ["small"])
    assert "small" in repr(plan) and "1440 estimates" in repr(plan) and "seed 3" in repr(plan)
    one = plan.only(methods=["oestruc"])
    assert one.methods == ["oestruc nf=1"] and one.estimates == 480 and plan.estimates == 1440
    assert plan.replace(trials=2).estimates == 48
    assert pickle.loads(pickle.dumps(one)) == one


def test_a_plan_that_cannot_be_is_an_error_of_its_kind(tmp_path):
    with pytest.raises(StudyError, match="no such file.*thesis"):
        Plan("nowhere")
    with pytest.raises(StudyError, match="no shipped plan|no such file"):
        Plan(Path("thesis"))
    with pytest.raises(StudyError, match="`plant` is missing"):
        Plan({"format": "deadtime/plan@1", "name": "x"})
    with pytest.raises(StudyError, match="there is no method `p9d`.*arxstruc"):
        Plan(SMALL).only(methods=["p9d"])
    with pytest.raises(RegistryError, match="unheard"):
        deadtime.study(SMALL.replace('"crosscorr"]', '"unheard"]'))
    with pytest.raises(ValueError, match="trials is 0"):
        Plan(SMALL).replace(trials=0)
    with pytest.raises(TypeError, match="a plan is"):
        Plan(3)


def test_estimates_are_those_of_the_csv_file(small):
    estimates = small.estimates()
    with open(small.folder / "estimates.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(estimates) and len(rows) == len(estimates["cell"]) == 1440
    for name, values in estimates.items():
        for row, value in zip(rows, values.tolist(), strict=True):
            text = row[name]
            same = text == value if isinstance(value, str) else value != value if text == "" else float(text) == value
            assert same, (name, text, value)


def test_cells_are_what_the_estimates_say(small):
    estimates = small.estimates()
    for number, cell in enumerate(small.cells):
        mine = estimates["cell"] == number
        assert mine.sum() == cell["trials"] == 60
        assert set(estimates["plant"][mine]) == {cell["plant"]} and set(estimates["method"][mine]) == {cell["method"]}
        errors = estimates["error_samples"][mine]
        rms = np.sqrt(np.nanmean(errors**2)) if np.isfinite(errors).any() else None
        assert cell["rms_samples"] == rms or cell["rms_samples"] == pytest.approx(rms, rel=1e-12)
        truth, lo, hi = (estimates[name][mine] for name in ("true_delay_s", "lo_s", "hi_s"))
        held = ((lo - 1e-9 <= truth) & (truth <= hi + 1e-9))[np.isfinite(lo)]
        assert cell["intervals"] == held.size
        assert cell["coverage95"] == (None if held.size == 0 else pytest.approx(held.mean()))


def test_estimates_come_as_frames_and_tables_too(small):
    arrays = small.estimates()
    pandas, polars, arrow = (small.estimates(kind) for kind in ("pandas", "polars", "pyarrow"))
    assert list(pandas.columns) == polars.columns == arrow.column_names == list(arrays)
    for name, values in arrays.items():
        wanted = [None if isinstance(v, float) and v != v else v for v in values.tolist()]
        assert polars[name].to_list() == arrow[name].to_pylist() == wanted
        assert equal({name: pandas[name].to_numpy(values.dtype)}, {name: values})
    with pytest.raises(ValueError, match="numpy, pandas, polars, pyarrow"):
        small.estimates("excel")


def test_nothing_is_left_on_disk_without_a_folder_and_the_numbers_are_the_same(small):
    memory = deadtime.study(SMALL, threads=1)
    assert memory.folder is None and results(memory) == results(small) and equal(memory.estimates(), small.estimates())
    with pytest.raises(FileNotFoundError, match="kept in memory"):
        memory.parts()
    again = pickle.loads(pickle.dumps(memory))
    assert results(again) == results(memory) and equal(again.estimates(), memory.estimates())


def test_a_study_is_read_again_from_its_folder(small, tmp_path):
    read = deadtime.read_study(small.folder)
    assert read.to_json() == small.to_json() and equal(read.estimates(), small.estimates())
    assert read.plan is None and read.published == [] and read.aims == []
    small.save(tmp_path / "study.json")
    assert (tmp_path / "study.json").read_text() == (small.folder / "study.json").read_text()
    with pytest.raises(FileNotFoundError, match="estimates"):
        deadtime.read_study(tmp_path).estimates()
    with pytest.raises(FileError):
        deadtime.read_study(tmp_path / "nowhere")
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(StudyError, match="deadtime/study@1"):
        deadtime.read_study(tmp_path)


def test_aims_and_published_numbers_stand_beside_ours(small):
    (aim,) = small.aims
    assert aim["met"] and aim["method"] == "arxstruc" and aim["at_most"] == 1000
    (beside,) = small.published
    mean = np.mean([c["rms_samples"] for c in small.cells if c["method"] == "crosscorr" and c["plant"] == "fast1" and c["snr"] == 100])
    assert beside["published"] == 1e9 and beside["standing"] == "differing" and beside["ours"] == pytest.approx(mean)
    text = " ".join(str(small).split())
    assert "Aims:" in text and "0 matching, 1 differing" in text and "90 % kept" in text
    assert "Aims:" not in repr(small) and repr(small).startswith("small: A small plan.") and "oestruc nf=1" in repr(small)
    assert "<table>" in small._repr_html_() and len(small.scores) == 3 * 2


def test_a_figure_shows_every_method(small):
    figure = small.plot()
    errors, coverage = figure.axes
    assert [label.get_text() for label in errors.get_yticklabels()] == ["arxstruc", "oestruc nf=1", "crosscorr"]
    assert "95 %" in coverage.get_xlabel() and len(errors.lines) >= 6


def test_progress_is_told_and_may_stop_the_work(tmp_path):
    told: list[tuple[int, int]] = []
    deadtime.study(SMALL, progress=lambda done, of: told.append((done, of)))
    assert told == sorted(told) and told[-1] == (1440, 1440)

    def enough(done: int, of: int) -> None:
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        deadtime.study(SMALL, tmp_path / "out", progress=enough)


def test_ctrl_c_is_heard_within_a_fifth_of_a_second_and_the_study_goes_on_from_there(tmp_path):
    long = Plan(SMALL).replace(trials=100).only(methods=["arxstruc", "oestruc"])
    for attempt in range(3):
        out = tmp_path / f"out{attempt}"
        # The machine may be busy: one of three tries has to.
        if interrupted(lambda out=out: deadtime.study(long, out, threads=1), 1.0) < 0.2:
            break
    else:
        pytest.fail("Ctrl-C was heard too late three times")
    # The thread that worked ends with the record that it was at.
    time.sleep(0.3)
    done = {p.name: p.stat().st_mtime_ns for p in (out / "parts").glob("*.csv")}
    assert done and not (out / "study.json").exists()
    with pytest.raises(StudyError, match="resume=True"):
        deadtime.study(long, out)
    with pytest.raises(StudyError, match="another plan"):
        deadtime.study(long, out, seed=9, resume=True)
    first: list[int] = []
    resumed = deadtime.study(long, out, resume=True, progress=lambda done, of: first.append(done))
    assert first[0] >= 25 * 2 * len(done)
    assert results(resumed) == results(deadtime.study(long)) and not (out / "parts").exists()
    with pytest.raises(ValueError, match="out"):
        deadtime.study(long, resume=True)


def test_a_gate_passes_what_is_the_same_and_names_what_is_worse(small, tmp_path):
    small.write_baseline(tmp_path / "kept")
    same = deadtime.gate(small, tmp_path / "kept")
    assert same and same.passed and same.findings == [] and "nothing is worse" in repr(same)
    worse = small.to_dict()
    cell = next(c for c in worse["cells"] if c["snr"] is None and c["method"] == "arxstruc" and c["rms_samples"] is not None)
    cell["flagged"] = cell["trials"] - 1
    (tmp_path / "worse.json").write_text(json.dumps(worse))
    found = deadtime.gate(tmp_path / "worse.json", small)
    assert not found and found.findings[0]["method"] == "arxstruc" and found.findings[0]["measured"] == "flagged"
    suites = ElementTree.fromstring(found.junit())
    assert int(suites.get("failures")) == 1 and "arxstruc" in found.markdown() and "<li>" in found._repr_html_()
    found.save(tmp_path / "gate.json")
    assert json.loads((tmp_path / "gate.json").read_text()) == found.to_dict()
    better = deadtime.gate(small, tmp_path / "worse.json")
    assert better.passed and better.better


def test_a_gate_refuses_studies_of_different_plans(small):
    other = deadtime.study(KEYS)
    with pytest.raises(StudyError, match="small|keys"):
        deadtime.gate(other, small)
    with pytest.raises(StudyError, match="alpha"):
        deadtime.gate(small, small, alpha=2.0)

"""Studies and blind runs on a Dask cluster of several worker processes."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import blind_cases
import numpy as np
import pytest

import deadtime
import deadtime.dask
from deadtime import Plan, _native, blind
from deadtime.errors import FileError, RegistryError, StudyError

distributed = pytest.importorskip("distributed")

PLAN = """
format = "deadtime/plan@1"
name = "spread"
seed = 5
trials = 110
samples = 200
max_delay = 20
plant = ["slow2", "fast1"]
excitation = ["rbs"]
snr = [100, "inf"]
delay_s = [{ uniform_s = [2, 9] }]
method = ["arxstruc", "oestruc", "crosscorr"]
[scoring]
kept_percent = [100, 90]
"""
# Some delays make this loop unstable: its records explode.
WILD = """
format = "deadtime/plan@1"
name = "wild"
trials = 100
samples = 2000
plant = "fast1"
excitation = "rbs"
loop = "closed"
controller = "wild"
delay_s = [{ uniform_s = [1, 30], whole = true }]
method = "arxstruc"
[controllers]
wild = { numerator = [1000.0], denominator = [1.0] }
"""


@pytest.fixture(scope="session")
def cluster() -> Iterator[distributed.LocalCluster]:
    cluster = distributed.LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=None, memory_limit=None)
    yield cluster
    # A test kills a worker, and the cluster's list of workers may not know the one that took its place yet: `distributed` then fails while it closes.
    with contextlib.suppress(KeyError):
        cluster.close()


@pytest.fixture(scope="session")
def client(cluster: distributed.LocalCluster) -> Iterator[distributed.Client]:
    with distributed.Client(cluster) as client:
        yield client


@pytest.fixture(scope="session")
def alone() -> deadtime.Study:
    """The same study by one machine."""
    return deadtime.study(PLAN)


def results(study: deadtime.Study) -> dict:
    """A study without its run times, which are no part of the result."""
    whole = study.to_dict()
    for cell in whole["cells"]:
        cell["time_per_estimate_s"] = None
    return whole


def agree(ours: deadtime.Study, alone: deadtime.Study) -> bool:
    """The same cells and the same estimates to the bit, run times apart."""
    a, b = ours.estimates(), alone.estimates()
    bits = [n for n in a if n != "time_s"]
    same = all(a[n].dtype == b[n].dtype and np.array_equal(a[n], b[n], equal_nan=a[n].dtype.kind == "f") for n in bits)
    return list(a) == list(b) and same and results(ours) == results(alone)


def parts(out: Path) -> dict[str, int]:
    return {p.name: p.stat().st_mtime_ns for p in (out / "estimates").glob("part-*.parquet")}


def test_a_cluster_finds_to_the_bit_what_one_machine_finds(client, alone, tmp_path):
    told: list[tuple[int, int]] = []
    ours = deadtime.dask.run_study(PLAN, client, tmp_path, progress=lambda done, of: told.append((done, of)))
    assert agree(ours, alone) and agree(deadtime.read_study(tmp_path), alone)
    assert told[0] == (0, 1320) and told[-1] == (1320, 1320) and told == sorted(told)
    assert (tmp_path / "tables.md").read_text().startswith("# spread")
    assert set(os.listdir(tmp_path)) == {"estimates", "report.html", "study.json", "tables.md", "tasks.json"}


def test_parts_that_are_sent_back_are_the_same(client, alone, tmp_path):
    assert agree(deadtime.dask.run_study(PLAN, client, tmp_path, block=2, shared=False, in_flight=4), alone)
    # Five blocks of at most 25 records for each of four settings, two at a time; no task ends within a setting that it shares.
    assert len(parts(tmp_path)) == 12


def test_duckdb_polars_and_pandas_read_the_parts_as_one_data_set(client, tmp_path):
    duckdb, pandas, polars = pytest.importorskip("duckdb"), pytest.importorskip("pandas"), pytest.importorskip("polars")
    study = deadtime.dask.run_study(PLAN, client, tmp_path, block=1)
    folder = tmp_path / "estimates"
    assert len(parts(tmp_path)) == 20
    wanted = study.estimates()
    by_pandas = pandas.read_parquet(folder)
    by_polars = polars.read_parquet(folder / "*.parquet")
    by_duckdb = duckdb.sql(f"select * from read_parquet('{folder}/*.parquet') order by cell, trial").df()
    order = np.lexsort((wanted["trial"], wanted["cell"]))
    frames = {
        "pandas": by_pandas.sort_values(["cell", "trial"]),
        "polars": by_polars.sort("cell", "trial").to_pandas(),
        "duckdb": by_duckdb,
    }
    for name, frame in frames.items():
        assert list(frame.columns) == list(wanted), name
        for column, values in wanted.items():
            got = frame[column].to_numpy(values.dtype)
            assert np.array_equal(got, values[order], equal_nan=values.dtype.kind == "f"), (name, column)
    # A cell's place in study.json is a column: the two join.
    query = f"select cell, sqrt(avg(error_samples ** 2)) from read_parquet('{folder}/*.parquet') group by cell"
    means = duckdb.sql(query).fetchall()
    assert all(study.cells[cell]["rms_samples"] == pytest.approx(rms, rel=1e-12) for cell, rms in means if rms is not None)


def test_a_worker_that_is_killed_loses_nothing_and_doubles_nothing(client, alone, tmp_path):
    client.wait_for_workers(3)
    pids = client.run(os.getpid)
    killed: list[int] = []

    def kill(done: int, of: int) -> None:
        busy = [address for address, tasks in client.processing().items() if tasks and address in pids]
        if done > of / 4 and busy and not killed:
            killed.append(pids[busy[0]])
            os.kill(killed[0], signal.SIGKILL)

    ours = deadtime.dask.run_study(PLAN, client, tmp_path, block=1, progress=kill)
    assert killed and agree(ours, alone) and len(parts(tmp_path)) == 20
    assert not list((tmp_path / "estimates").glob(".tmp*"))
    client.wait_for_workers(3, timeout=30)
    assert killed[0] not in client.run(os.getpid).values()


def test_a_worker_that_retires_hands_its_tasks_over(client, cluster, alone, tmp_path):
    client.wait_for_workers(3, timeout=30)
    gone: list[str] = []

    def retire(done: int, of: int) -> None:
        if done > of / 4 and not gone:
            gone.extend(list(client.nthreads())[:1])
            client.retire_workers(gone, close_workers=True)

    try:
        assert agree(deadtime.dask.run_study(PLAN, client, tmp_path, block=1, progress=retire), alone) and gone
        assert gone[0] not in client.nthreads()
    finally:
        # The cluster counts the one that is gone, too.
        cluster.scale(4)
        client.wait_for_workers(3, timeout=30)


def test_a_client_that_is_interrupted_goes_on_where_it_was(client, alone, tmp_path):
    def interrupt(done: int, of: int) -> None:
        if done > of / 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        deadtime.dask.run_study(PLAN, client, tmp_path, block=1, progress=interrupt)
    done = parts(tmp_path)
    assert 6 <= len(done) < 20 and not (tmp_path / "study.json").exists()
    with pytest.raises(StudyError, match="resume=True"):
        deadtime.dask.run_study(PLAN, client, tmp_path)
    with pytest.raises(StudyError, match="another study"):
        deadtime.dask.run_study(PLAN, client, tmp_path, seed=6, resume=True)
    # One part was damaged meanwhile, and one belongs to another study.
    damaged, foreign = sorted(done)[:2]
    (tmp_path / "estimates" / damaged).write_bytes(b"PAR1 or so")
    other = _native.Runner(Plan(PLAN).replace(seed=6))
    (tmp_path / "estimates" / foreign).write_bytes(other.part(0, 1))
    first: list[int] = []
    ours = deadtime.dask.run_study(PLAN, client, tmp_path, resume=True, progress=lambda done, of: first.append(done))
    after = parts(tmp_path)
    assert first[0] >= 3 * 10 * (len(done) - 2) and agree(ours, alone)
    assert all(after[name] == time_ns for name, time_ns in done.items() if name not in (damaged, foreign))
    # Nothing is left to do: the parts are added up again.
    assert agree(deadtime.dask.run_study(PLAN, client, tmp_path, resume=True), alone) and parts(tmp_path) == after


def test_a_client_that_is_killed_loses_no_part(cluster, client, alone, tmp_path):
    script = """
        import sys
        import distributed
        import deadtime.dask
        deadtime.dask.run_study(sys.argv[1], distributed.Client(sys.argv[2]), sys.argv[3], block=1)
    """
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    out = tmp_path / "out"
    command = [sys.executable, "-c", textwrap.dedent(script), os.fspath(plan), cluster.scheduler_address, os.fspath(out)]
    other = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        while len(parts(out)) < 3 and other.poll() is None:
            time.sleep(0.01)
    finally:
        other.kill()
        other.wait()
    assert 3 <= len(parts(out)) < 20 and not (out / "study.json").exists()
    assert agree(deadtime.dask.run_study(plan, client, out, resume=True), alone)


def test_a_task_that_runs_twice_changes_nothing(client, alone, tmp_path):
    deadtime.dask.run_study(PLAN, client, tmp_path, block=2)
    plan = Plan(PLAN)
    runner = _native.Runner(plan)
    tasks = _native.Tasks.open(runner, tmp_path, True)
    first, end = tasks.blocks(1)
    sent = (plan._bare(), os.fspath(plan.folder), runner.stamp, first, end, os.fspath(tasks.path(1)))
    both = [client.submit(deadtime.dask._make, *sent, pure=False) for _ in range(3)]
    assert len({made.size for made in client.gather(both)}) <= 3
    assert tasks.missing() == [] and agree(deadtime.dask.run_study(PLAN, client, tmp_path, resume=True), alone)


def test_a_record_that_cannot_be_made_is_told_with_setting_and_seed(client, tmp_path):
    plan = Plan(WILD).replace(seed=4)
    with pytest.raises(StudyError, match=r"plan wild, fast1 zoh rbs .*Closed wild delay 1\.\.30 whole s.*trial \d+ \(seed \d+\).*explodes"):
        deadtime.dask.run_study(plan, client, tmp_path, block=1)
    assert not (tmp_path / "study.json").exists()


def test_a_plan_that_cannot_be_run_reaches_no_worker(client, tmp_path):
    with pytest.raises(RegistryError, match="unheard"):
        deadtime.dask.run_study(PLAN.replace('"crosscorr"]', '"unheard"]'), client, tmp_path)
    with pytest.raises(StudyError, match="no such file"):
        deadtime.dask.run_study("nowhere", client, tmp_path)
    assert os.listdir(tmp_path) == []
    with pytest.raises(ValueError, match="block is 0"):
        deadtime.dask.run_study(PLAN, client, tmp_path, block=0)
    with pytest.raises(ValueError, match="task_seconds"):
        deadtime.dask.run_study(PLAN, client, tmp_path, task_seconds=0)
    (tmp_path / "estimates").mkdir()
    (tmp_path / "estimates" / "mine.parquet").write_text("")
    with pytest.raises(StudyError, match="no part of this study"):
        deadtime.dask.run_study(PLAN, client, tmp_path)
    # A folder that cannot be written to, for root as well.
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError):
        deadtime.dask.run_study(PLAN, client, tmp_path / "file" / "out", block=1)


def test_a_worker_of_another_version_is_told_from_ours(client):
    plan = Plan(PLAN)
    with pytest.raises(StudyError, match="install the client's version"):
        client.submit(deadtime.dask._cost, plan._bare(), os.fspath(plan.folder), "another stamp", 0).result()


def test_a_task_that_kills_its_workers_is_told_and_given_up(client):
    def deadly() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(StudyError, match="task 7: workers died on it again and again"):
        list(deadtime.dask._results(distributed, client, "deadtime-test", deadly, [7], lambda task: (), None))
    client.wait_for_workers(3, timeout=30)


def test_a_folder_that_workers_do_not_share_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(deadtime.dask, "PATIENCE", 0.3)
    with pytest.raises(StudyError, match="shared=False"):
        deadtime.dask._wait_for(tmp_path / "part-00000000.parquet")


def test_model_files_of_a_plan_are_read_by_the_workers(client, tmp_path):
    (tmp_path / "lag.toml").write_text(blind_cases.MODEL)
    (tmp_path / "plan.toml").write_text(PLAN.replace('["slow2", "fast1"]', '"lag.toml"').replace("trials = 110", "trials = 30"))
    ours = deadtime.dask.run_study(tmp_path / "plan.toml", client, tmp_path / "out")
    assert agree(ours, deadtime.study(tmp_path / "plan.toml"))
    # The file means something else now: what was begun does not go on with it.
    (tmp_path / "lag.toml").write_text(blind_cases.MODEL.replace("-2.0", "-3.0"))
    with pytest.raises(StudyError, match="another study"):
        deadtime.dask.run_study(tmp_path / "plan.toml", client, tmp_path / "out", resume=True)


@pytest.mark.parametrize(("cost", "least"), [(1e-9, 1), (0.01, 2), (10.0, 5000)])
def test_tasks_hold_every_block_once_and_take_about_as_long_as_they_should(cost, least):
    runner = _native.Runner(Plan("bjorklund").replace(trials=1000), tried=False)
    kinds = runner.kinds()
    ends = runner.tasks([cost] * len(kinds), 10.0)
    assert ends == sorted(set(ends)) and ends[-1] == runner.blocks and len(ends) >= least
    sizes = np.diff([0, *ends])
    estimates = [runner.estimates_of(end - size, end) for size, end in zip(sizes, ends, strict=True)]
    assert sum(estimates) == runner.estimates and max(estimates) <= 400_000
    assert sum(records for _, records in kinds) == runner.blocks * 25
    # A block is 25 records here, and no task is longer than it should be, unless it is a single block.
    assert all(size == 1 or size * 25 * cost <= 10.0 + 1e-9 for size in sizes)


def test_verdicts_of_a_cluster_are_those_of_one_machine(client, tmp_path):
    cases, labels = blind_cases.make(tmp_path, {"a": 4, "b": 0, "c": 2})
    (cases / "c" / "train_1.csv").write_text("time,u,y\n0,0,x\n")
    one = blind.run(cases, tmp_path / "one")
    told: list[blind.CaseOutcome] = []
    many = deadtime.dask.run_blind(cases, tmp_path / "many", client, progress=told.append)
    assert [(c.id, c.outcome, c.error) for c in many] == [(c.id, c.outcome, c.error) for c in one]
    assert len(told) == 3 and list(many.failed) == ["c"]
    for name in ("a", "b"):
        for file in ("diagnosis.json", "commitment.txt"):
            assert (tmp_path / "one" / name / file).read_bytes() == (tmp_path / "many" / name / file).read_bytes()
    assert not (tmp_path / "many" / "c" / "run.json").exists()
    (labels / "c.json").unlink()
    assert blind.score(tmp_path / "many", labels).to_dict()["scores"][0] == blind.score(tmp_path / "one", labels).to_dict()["scores"][0]
    again = deadtime.dask.run_blind(cases, tmp_path / "many", client)
    assert [c.outcome for c in again] == ["kept", "kept", "failed"]


def test_what_goes_to_workers_can_be_pickled():
    for one in (Plan("thesis"), deadtime.dask._make, deadtime.dask._cost, deadtime.dask._diagnose, StudyError("so")):
        again = pickle.loads(pickle.dumps(one))
        assert again == one or repr(again) == repr(one)


def test_an_asynchronous_client_is_refused():
    class Asynchronous:
        asynchronous = True

    with pytest.raises(TypeError, match="synchronous"):
        deadtime.dask.run_study(PLAN, Asynchronous(), "nowhere")


def test_without_dask_the_remedy_is_told():
    script = "import sys; sys.modules['distributed'] = None; import deadtime.dask; deadtime.dask.run_study('thesis', None, 'x')"
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert said.returncode == 1 and "ImportError: many machines need Dask: pip install deadtime[dask]" in said.stderr

"""Worker processes: they give the same table, and when they die, a study goes on."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from pathlib import Path
from types import SimpleNamespace

import pytest

import mems_impact as mi
from mems_impact.studies.engine.executors import WorkerPool
from mems_impact.studies.engine.scheduler import run_study
from tests.studies.toys import Toy, bits

STUDY = Toy(size=30, failing=(5,))


@pytest.fixture
def pool(forking):
    def make():
        return ProcessPoolExecutor(2, mp_context=forking)

    return make


@pytest.mark.parametrize("study", [STUDY, Toy(size=30, chained=(20, 10))], ids=str)
def test_processes_give_the_same_table(pool, study):
    assert bits(run_study(study, executor=pool)) == bits(run_study(study))
    with pool() as executor:
        assert bits(run_study(study, executor=executor)) == bits(run_study(study))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_processes_by_every_method(method):
    import multiprocessing

    context = multiprocessing.get_context(method)
    table = run_study(STUDY, executor=lambda: ProcessPoolExecutor(2, mp_context=context))
    assert bits(table) == bits(run_study(STUDY))


@pytest.mark.parametrize("chained", [pytest.param((), marks=pytest.mark.slow), (20, 10)])
def test_a_chunk_whose_worker_dies_is_tried_again(pool, tmp_path, chained):
    study = Toy(size=30, flaky=2, where=str(tmp_path / "death"), chained=chained)
    table = run_study(study, executor=pool)
    assert len(os.listdir(tmp_path)) == 2
    assert bits(table) == bits(run_study(Toy(size=30, chained=chained)))


def test_a_chunk_that_kills_three_workers_is_given_up(pool):
    made = []

    def make():
        made.append(pool())
        return made[-1]

    table = run_study(Toy(size=30, deadly=(13,)), executor=make)
    failed = table[table["status"] != "ok"]
    assert failed["point"].tolist() == [12, 13, 14, 15]
    assert set(failed["status"].str[:30]) == {"its chunk killed 3 workers (A "}
    others = run_study(Toy(size=30)).drop(failed.index)
    assert bits(table.drop(failed.index)) == bits(others)
    assert len(made) == 4


@pytest.mark.slow
def test_workers_that_cannot_be_restarted_leave_finished_points(pool, tmp_path):
    study = Toy(size=30, flaky=1, where=str(tmp_path / "death"), each=0.001)
    executor = pool()
    with pytest.raises(mi.WorkersLost, match="function that makes executors") as caught:
        run_study(study, executor=executor, store=tmp_path / "store")
    executor.shutdown(wait=False)  # Python may wait for ever for a pool whose worker was killed
    lost = caught.value
    assert len(lost.partial) == mi.load(tmp_path / "store").done < 30
    table = run_study(study, executor=pool, store=tmp_path / "store")
    assert bits(table) == bits(run_study(Toy(size=30)))


def die():
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.nightly
def test_workers_that_die_before_they_compute_are_no_fault_of_the_points(forking):
    def make():
        return ProcessPoolExecutor(2, mp_context=forking, initializer=die)

    with pytest.raises(mi.WorkersLost, match=r"die before they compute anything.*; see that mem"):
        run_study(STUDY, executor=make)


UNGUARDED = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

from mems_impact.studies.engine.scheduler import run_study
from tests.studies.toys import Toy

context = multiprocessing.get_context("{method}")
run_study(Toy(size=4), executor={make}ProcessPoolExecutor(1, mp_context=context))
"""


@pytest.mark.nightly
@pytest.mark.parametrize("make", ["", "lambda: "])
@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_a_script_without_a_main_guard_is_an_error(tmp_path, method, make):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED.format(method=method, make=make))
    root = str(Path(mi.__file__).parents[1])
    ended = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": root},
    )  # fmt: skip
    assert "__main__':, since each worker imports the script" in ended.stderr
    assert ended.stderr.count("WorkersLost") > 0


def test_an_executor_that_was_shut_down():
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(mi.WorkersLost, match="after 0 of 30 points"):
        run_study(STUDY, executor=executor)


class Racing(ThreadPoolExecutor):
    """A pool one of whose workers dies just while it starts another: its queue is closed then."""

    def __init__(self, calls):
        super().__init__(2)
        self.calls = calls

    def submit(self, *args, **kwargs):
        self.calls -= 1
        if self.calls < 0:
            raise OSError("handle is closed")
        return super().submit(*args, **kwargs)


def test_a_pool_that_breaks_while_it_starts_a_worker_is_replaced():
    made = []

    def make():
        made.append(Racing(3) if not made else ThreadPoolExecutor(2))
        return made[-1]

    assert bits(run_study(STUDY, executor=make, chunk=4)) == bits(run_study(STUDY))
    assert len(made) == 2


def test_a_worker_that_dies_before_its_pool_watches_it(forking):
    with ProcessPoolExecutor(3, mp_context=forking) as executor:
        future = executor.submit(time.sleep, 60)
        while not future.running():
            time.sleep(0.01)
        executor._spawn_process()  # as a submission does, after its pool has begun to wait
        newest = list(executor._processes.values())[-1]
        newest.kill()
        newest.join()
        with WorkerPool(STUDY, executor, None) as crew:
            crew.report_dead_workers()
            with pytest.raises(BrokenExecutor):
                future.result(timeout=20)


def test_a_pool_that_never_starts_a_worker_leaves_what_was_done():
    with pytest.raises(mi.WorkersLost, match=r"handle is closed.*; see that memory"):
        run_study(STUDY, executor=lambda: Racing(0))


@pytest.mark.usefixtures("heard_in_background")
def test_ctrl_c_ends_processes(pool):
    made = []

    def make():
        made.append(pool())
        return made[-1]

    def press(_):
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(mi.Interrupted):  # within a day, at the first report
        run_study(Toy(size=8, each=1e5), executor=make, progress=press)
    assert len(made) == 1


def compute(path, forking_method):
    """Compute with processes that tell who they are in a file."""
    import multiprocessing

    context = multiprocessing.get_context(forking_method)

    def make():
        executor = ProcessPoolExecutor(2, mp_context=context)
        workers = {executor.submit(os.getpid).result()} | {executor.submit(pid).result()}
        path.with_suffix(".part").write_text(" ".join(map(str, workers)))
        path.with_suffix(".part").rename(path)
        return executor

    run_study(Toy(size=100, each=0.2, grain=1), executor=make)


def pid():
    time.sleep(0.05)  # so that both workers have come
    return os.getpid()


@pytest.mark.nightly
def test_workers_go_with_the_process_that_they_work_for(forking, tmp_path):
    path = tmp_path / "workers"
    driver = forking.Process(target=compute, args=(path, "fork"))
    driver.start()
    while not path.exists():
        assert driver.is_alive()
        time.sleep(0.01)
    workers = [int(word) for word in path.read_text().split()]
    time.sleep(0.5)  # so that they compute
    driver.kill()
    driver.join()
    while any(map(is_there, workers)):  # for ever, if they stayed
        time.sleep(0.01)


def is_there(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


class Deserted(Executor):
    """A cluster to which no worker has come yet, as Dask's executor shows it."""

    _client = SimpleNamespace(nthreads=dict)

    def submit(self, *_arguments):
        return Future()


def test_that_no_worker_comes_is_said_once(monkeypatch, caplog):
    monkeypatch.setattr("mems_impact.studies.engine.executors.WORKER_WAIT_SECONDS", 0.0)
    looks = []

    def stop(done):
        looks.append(done)
        if len(looks) == 3:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted):
        run_study(STUDY, executor=Deserted(), progress=stop)
    assert caplog.messages == ["waiting for workers: the cluster has none; see its log"]

"""Studies run chunk by chunk: the same table by any number of any workers."""

import math
import signal
import threading
import traceback
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.studies.engine.scheduler import run_study
from mems_impact.studies.engine.study import Chunk, layout
from tests.studies.toys import EDGES, Toy, bits, ctrl_c_in

INDEPENDENT = Toy(size=37, failing=(5, 11))
CHAINED = Toy(size=37, chained=(20, 1, 16), failing=(5,))


def test_a_table_has_the_rows_of_the_points_in_their_order():
    table = run_study(INDEPENDENT)
    assert list(table.columns) == list(INDEPENDENT.schema)
    assert table["point"].tolist() == list(range(37))
    good = table["status"] == "ok"
    assert table.index[~good].tolist() == [5, 11]
    assert set(table.loc[~good, "status"]) == {"no luck"}
    np.testing.assert_array_equal(table.loc[good, "number"], np.sin(table.index[good] + 1))
    np.testing.assert_array_equal(table["edge"], [EDGES[i % len(EDGES)] for i in range(37)])
    assert table["edge"].map(lambda x: math.copysign(1, x)).iloc[0] == -1.0
    assert table["odd"].dtype == bool
    assert table.attrs["units"] == {"number": "m"}
    assert table.attrs["study"] == "toy"
    assert set(table.attrs["versions"]) == {"mems_impact", "numpy", "SUNDIALS", "python"}


def test_a_chain_continues_from_the_point_before():
    table = run_study(Toy(size=6, chained=(4, 2)))
    sines = np.sin(np.arange(6) + 1)
    expected = [*np.cumsum(sines[:4]), *np.cumsum(sines[4:])]
    np.testing.assert_allclose(table["number"], expected, rtol=1e-15)


@pytest.mark.parametrize("study", [INDEPENDENT, CHAINED, Toy(size=37, doubled=True)], ids=str)
@pytest.mark.parametrize(("workers", "chunk"), [(1, 1), (1, 37), (2, 1), (2, 5), (3, 16), (2, 99)])
def test_neither_workers_nor_chunks_matter(study, workers, chunk):
    expected = bits(run_study(study, workers=1))
    assert bits(run_study(study, workers=workers, chunk=chunk)) == expected


def test_points_of_several_rows():
    table = run_study(Toy(size=5, doubled=True))
    assert table["point"].tolist() == [0, 0, 1, 2, 2, 3, 4, 4]


def test_a_study_without_points():
    assert len(run_study(Toy(size=0))) == 0


def test_parts_cover_all_points():
    assert layout(10, (), 4) == [Chunk(0, 4, False), Chunk(4, 8, False), Chunk(8, 10, False)]
    parts = layout(7, (range(5), range(5, 7)), 3)
    assert parts == [Chunk(0, 3, False), Chunk(3, 5, True), Chunk(5, 7, False)]


class Recording(Executor):
    """Computes when it is asked for, and remembers how much waits at a time."""

    def __init__(self):
        self.most = self.waiting = 0
        self.threads = ThreadPoolExecutor(2)

    def submit(self, function, /, *arguments):
        self.waiting += 1
        self.most = max(self.most, self.waiting)
        future: Future = self.threads.submit(function, *arguments)
        future.add_done_callback(self.count)
        return future

    def count(self, _):
        self.waiting -= 1


def test_any_executor_gets_a_bounded_number_of_chunks():
    executor = Recording()
    table = run_study(Toy(size=400), executor=executor, workers=2, chunk=2)
    assert bits(table) == bits(run_study(Toy(size=400)))
    assert 2 <= executor.most <= 5
    assert executor.submit(int).result() == 0  # it is not ours to be ended


def test_a_pool_of_threads_of_the_user():
    with ThreadPoolExecutor(2) as threads:
        assert bits(run_study(CHAINED, executor=threads)) == bits(run_study(CHAINED))


class Alone(Toy):
    """Cannot be computed in two threads at a time."""

    busy = threading.Lock()
    threaded = False

    def compute(self, first, last, carried=None, watch=None):
        assert self.busy.acquire(blocking=False)
        try:
            return super().compute(first, last, carried, watch)
        finally:
            self.busy.release()


def test_what_threads_cannot_share_is_computed_by_one_at_a_time():
    study = Alone(size=40, each=0.001)
    with ThreadPoolExecutor(3) as threads:
        assert bits(run_study(study, executor=threads)) == bits(run_study(study, workers=3))


def test_progress_counts_points():
    heard = []
    run_study(Toy(size=40), progress=heard.append, chunk=4, workers=1)
    assert heard == sorted(heard)
    assert heard[-1] == 40


@pytest.mark.parametrize("study", [Toy(size=40), Toy(size=40, chained=(25, 15))], ids=str)
def test_an_interruption_keeps_what_is_done(study):
    def interrupt(done):
        if done >= 12:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as caught:
        run_study(study, progress=interrupt, chunk=4, workers=2)
    stop = caught.value
    assert 12 <= len(stop.partial) < 40
    assert (stop.work, stop.after) == ("toy", f"{len(stop.partial)} of 40 points")
    whole = run_study(study)
    rows = whole[whole["point"].isin(stop.partial["point"])].reset_index(drop=True)
    assert bits(stop.partial) == bits(rows)


@pytest.mark.usefixtures("heard_in_background")
def test_ctrl_c_ends_threads():
    before = threading.active_count()
    study = Toy(size=10**9, each=0.05)  # for years, if it were not heard

    def press(done):
        if done >= 1:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(mi.Interrupted):
        run_study(study, workers=2, chunk=10**6, progress=press)
    assert threading.active_count() == before


@pytest.mark.usefixtures("heard_in_background")
@pytest.mark.parametrize("function", ["wait", "submit", "exception", "result"])
def test_ctrl_c_leaves_no_lock_of_the_executor_acquired(function):
    """It interrupts between calls of `concurrent.futures`, not within."""

    def within(frame):
        place = frame.f_code.co_filename, frame.f_code.co_name
        return "concurrent" in place[0] and place[1] == function

    with pytest.raises(mi.Interrupted) as caught, ctrl_c_in(within):
        run_study(Toy(size=40), workers=2, chunk=4)
    interrupt = caught.value.__context__
    assert isinstance(interrupt, KeyboardInterrupt)
    files = [frame.filename for frame in traceback.extract_tb(interrupt.__traceback__)]
    assert not any("concurrent" in file for file in files)


def test_what_a_point_raises_comes_as_it_is_with_what_was_done():
    with pytest.raises(ZeroDivisionError, match="point 17") as caught:
        run_study(Toy(size=40, buggy=(17,)), workers=1, chunk=4)
    done = caught.value.partial["point"].tolist()
    assert done[:16] == list(range(16))
    assert 17 not in done
    assert caught.value.__notes__ == [f"{len(done)} of 40 points are done"]


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"workers": 0}, "workers"),
        ({"chunk": 0}, "chunk"),
        ({"chunk": 1.5}, "chunk"),
        ({"executor": "threads"}, "executor"),
        ({"executor": lambda: "threads"}, "executor"),
    ],
)
def test_refused(arguments, field):
    with pytest.raises(mi.InvalidParameter) as caught:
        run_study(Toy(), **arguments)
    assert caught.value.field == field


def test_what_cannot_go_to_other_processes_is_said():
    study = Toy(extra={"lock": threading.Lock()})
    with pytest.raises(mi.InvalidParameter, match="cannot go to other processes"):
        run_study(study, executor=Recording())

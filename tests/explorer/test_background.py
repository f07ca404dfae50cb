import threading

from mems_impact.explorer.background import LatestOnlyWorker

LONG = 10.0  # s that a test waits before it fails


def collected(compute, **waits):
    """Return a thread, what it has delivered, and what counts the deliveries."""
    found, came = [], threading.Semaphore(0)

    def deliver(request, result, error):
        found.append((request, result, error))
        came.release()

    return LatestOnlyWorker(compute, deliver, **waits), found, came


def test_what_is_asked_is_delivered():
    latest, found, came = collected(lambda request, watch: request + 1)
    latest.request(1)
    assert came.acquire(timeout=LONG)
    assert found == [(1, 2, None)]
    latest.stop()
    latest.join(LONG)


def test_superseded_requests_are_cancelled():
    begun, go_on = threading.Event(), threading.Event()

    def compute(request, watch):
        begun.set()
        if request == "first":
            assert go_on.wait(LONG)
            watch(0.0)
        return request

    latest, found, came = collected(compute)
    latest.request("first")
    assert begun.wait(LONG)
    latest.request("second")
    latest.request("third")
    go_on.set()
    assert came.acquire(timeout=LONG)
    assert [request for request, *_ in found] == ["third"]
    latest.stop()


def test_short_work_is_done_to_its_end():
    begun, go_on = threading.Event(), threading.Event()

    def compute(request, watch):
        begun.set()
        assert go_on.wait(LONG)
        watch(0.0)
        return request

    latest, found, came = collected(compute, patience=1000.0)
    latest.request("first")
    assert begun.wait(LONG)
    latest.request("second")
    go_on.set()
    assert came.acquire(timeout=LONG)
    assert came.acquire(timeout=LONG)
    assert [request for request, *_ in found] == ["first", "second"]
    latest.stop()


def test_an_error_is_delivered_and_the_thread_continues():
    def compute(request, watch):
        return 1 / request

    latest, found, came = collected(compute)
    latest.request(0)
    assert came.acquire(timeout=LONG)
    latest.request(4)
    assert came.acquire(timeout=LONG)
    assert isinstance(found[0][2], ZeroDivisionError)
    assert found[1] == (4, 0.25, None)
    latest.stop()


def test_a_thread_that_is_stopped_ends_its_work():
    begun = threading.Event()

    def compute(request, watch):
        begun.set()
        while True:
            watch(0.0)

    latest, found, _ = collected(compute, patience=1000.0)
    latest.request(1)
    assert begun.wait(LONG)
    latest.stop()
    latest.join(LONG)
    assert found == []

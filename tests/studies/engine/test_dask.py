"""Dask: worker processes of a real cluster on this machine, some of which die."""

import os
import signal

import pytest

import mems_impact as mi
from mems_impact.studies.engine.scheduler import run_study
from tests.studies.toys import Toy, bits

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed")  # no fast test waits for its import
    import dask

    few = {"distributed.scheduler.allowed-failures": 1}
    with (
        dask.config.set(few),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run(use_tests, os.getcwd())
        yield client


def use_tests(directory):
    import sys

    sys.path.insert(0, directory)


def test_the_table_is_the_same(client, tmp_path):
    for study in (Toy(size=200, failing=(5,)), Toy(size=60, chained=(40, 20))):
        store = tmp_path / str(study.size)
        table = run_study(study, executor=client.get_executor(), store=store)
        assert bits(table) == bits(run_study(study))
        assert bits(mi.load(store).table) == bits(table)


def test_a_sweep(client):
    zhao, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    arguments = zhao, drive, "amplitude", [0.2, 0.22, 0.24]
    spans = {"transient": 10, "periods": 4, "direction": "both"}
    table = mi.sweep(*arguments, **spans, executor=client.get_executor()).table
    assert bits(table) == bits(mi.sweep(*arguments, **spans).table)


def test_a_worker_that_is_killed_in_the_middle(client):
    killed = []

    def kill(done):
        if done >= 40 and not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    study = Toy(size=200, each=0.005)
    table = run_study(study, executor=client.get_executor(), progress=kill)
    assert bits(table) == bits(run_study(Toy(size=200)))
    assert killed


def test_an_interruption_gives_the_cluster_free(client):
    def interrupt(done):
        if done >= 20:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as caught:
        run_study(
            Toy(size=4000, each=0.005), executor=client.get_executor(), progress=interrupt, chunk=4
        )
    assert 20 <= len(caught.value.partial) < 4000
    assert client.submit(int).result(timeout=60) == 0


@pytest.mark.nightly
def test_a_chunk_that_kills_its_workers_is_given_up(client):
    # Dask does not bring a worker back that dies before it is known to have begun.
    study = Toy(size=40, deadly=(13,), agony=1.5)
    table = run_study(study, executor=client.get_executor())
    failed = table[table["status"] != "ok"]
    assert failed["point"].tolist() == [12, 13, 14, 15]
    assert failed["status"].str.startswith("its chunk killed 3 workers (Attempted to run").all()

"""Stores: a study that was killed goes on, and what cannot go on says why."""

import errno
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from zlib import crc32

import pytest

import mems_impact as mi
from mems_impact.studies.engine import store as locking
from mems_impact.studies.engine import store as parquet
from mems_impact.studies.engine.scheduler import run_study
from mems_impact.studies.engine.store import ChunkStore
from tests.studies.toys import CHUNK, Toy, bits, keep_computing

STUDY = Toy(size=30, failing=(5,), doubled=True)
CHAINED = Toy(size=30, chained=(20, 10))


@pytest.fixture
def store(tmp_path):
    return tmp_path / "out" / "store"


def broken_off(study, store, after, **arguments):
    def interrupt(done):
        if done >= after:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as caught:
        run_study(study, store=store, progress=interrupt, workers=1, **arguments)
    return caught.value


@pytest.mark.parametrize("stored", [True, False])
def test_an_interruption_after_a_part_is_kept_counts_it(store, stored, monkeypatch):
    """Between the file of a part, which stands, and the count of it."""
    counted, calls = ChunkStore.count, []

    def count(self, number, failed):
        calls.append(number)
        if len(calls) == 2:
            raise KeyboardInterrupt
        counted(self, number, failed)

    monkeypatch.setattr(ChunkStore, "count", count)
    with pytest.raises(mi.Interrupted) as caught:
        run_study(STUDY, store=store if stored else None, chunk=3, workers=1)
    assert caught.value.after == "6 of 30 points"
    assert caught.value.partial["point"].nunique() == 6


def chunks(store):
    return sorted(path.name for path in (store / "points").iterdir())


@pytest.mark.parametrize("study", [STUDY, CHAINED], ids=str)
def test_a_stored_table_is_the_table_to_the_last_bit(store, study):
    expected = bits(run_study(study))
    assert bits(run_study(study, store=store)) == expected
    assert bits(run_study(study, store=store)) == expected  # read alone
    assert bits(mi.load(store).table) == expected


@pytest.mark.parametrize("study", [STUDY, CHAINED], ids=str)
def test_an_interrupted_study_continues(store, study):
    stop = broken_off(study, store, 10, chunk=3)
    before = chunks(store)
    seen = mi.load(store)
    assert bits(seen.table) == bits(stop.partial)
    assert (seen.kind, f"{seen.done} of {seen.total} points") == (stop.work, stop.after)
    assert 9 <= seen.done < 30
    # With other workers and chunks, of which the store's own count.
    assert bits(run_study(study, store=store, workers=2, chunk=7)) == bits(run_study(study))
    assert set(before) < set(chunks(store))
    assert len(chunks(store)) == (11 if study is CHAINED else 10)


@pytest.mark.parametrize(("chained", "again"), [((), 3), ((12, 18), 6)])
def test_failed_points_are_computed_again(store, chained, again):
    sound = Toy(size=30, chained=chained)
    run_study(replace(sound, failing=(7,)), store=store, chunk=3)
    assert mi.load(store).failed == 1
    assert mi.load(store).discard_failed() == again
    assert mi.load(store).done == 30 - again
    assert bits(run_study(sound, store=store)) == bits(run_study(sound))
    assert mi.load(store).discard_failed() == 0


@pytest.mark.slow
@pytest.mark.parametrize("chained", [(), (500, 200, 300)], ids=["points", "chains"])
@pytest.mark.parametrize("kills", [1, 5])
def test_a_study_that_is_killed_continues(forking, store, chained, kills):
    quick = Toy(size=1000, chained=chained)
    long = replace(quick, each=0.05)  # so that it is not done before it is killed
    draw = random.Random(kills)
    for _ in range(kills):
        before = done_in(store)
        process = forking.Process(target=keep_computing, args=(long, store))
        process.start()
        wait_until(process, store, before + draw.randint(0, 40))
        time.sleep(draw.uniform(0.0, 0.1))
        process.kill()
        process.join()
        assert process.exitcode == -9
        assert before <= done_in(store) < 1000
    assert bits(run_study(quick, store=store)) == bits(run_study(quick))


def wait_until(process, store, points):
    """Wait until a process has done so many points."""
    while len(list(store.glob("points/0*"))) * CHUNK < points:
        assert process.is_alive()
        time.sleep(0.01)


def done_in(store):
    return mi.load(store).done if (store / "study.json").exists() else 0


def test_what_a_killed_process_leaves_is_removed(store):
    stop = broken_off(STUDY, store, 10, chunk=3)
    for folder in (store, store / "points"):
        (folder / ".mems_impact-77").mkdir()
        (folder / ".mems_impact-77" / "000000009-000000012.parquet").write_bytes(b"PAR1 half of it")
    assert stop.after == f"{mi.load(store).done} of 30 points"
    run_study(STUDY, store=store)
    assert [name for name in chunks(store) if name.startswith(".")] == []
    assert sorted(path.name for path in store.iterdir()) == ["lock", "points", "study.json"]


def test_a_chunk_that_was_cut_off_is_computed_again(store):
    expected = bits(run_study(STUDY, store=store))
    path = store / "points" / chunks(store)[1]
    whole = path.read_bytes()
    for content in (whole[:-9], whole[:40], b""):
        path.write_bytes(content)
        assert mi.load(store).done < 30
        assert bits(run_study(STUDY, store=store)) == expected


def test_a_wrong_bit_is_found(store):
    expected = bits(run_study(STUDY, store=store))
    path = store / "points" / chunks(store)[0]
    content = path.read_bytes()
    refusals = set()
    for place in range(4, len(content), 23):
        damaged = bytearray(content)
        damaged[place] ^= 1
        path.write_bytes(damaged)
        try:
            seen = mi.load(store)
            # It is of no consequence, or the chunk counts as missing.
            assert seen.done < 30 or bits(seen.table) == expected
        except mi.InvalidFile as error:
            refusals.add(str(error))
    assert len(refusals) > 1
    for refusal in refusals:
        assert refusal.startswith(f"{path}: is damaged")
        assert refusal.endswith("; remove it, and run the study again: other chunks are kept")
    path.unlink()
    assert bits(run_study(STUDY, store=store)) == expected


def test_every_bit_of_a_description_is_checked(store):
    run_study(STUDY, store=store)
    path = store / "study.json"
    content = path.read_bytes()
    for bit in range(5, 8 * len(content), 61):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        for read in (mi.load, lambda store: run_study(STUDY, store=store)):
            with pytest.raises(mi.InvalidFile, match=r"study.json is damaged"):
                read(store)


@pytest.mark.parametrize(
    "entries",
    [
        {"points": 10**15, "chunk": 1}, {"chunk": 0}, {"chunk": None}, {"chains": [[0, 10**15]]},
        {"chains": 3}, {"attrs": "text"}, {"identity": -1}, {"schema": {"x": "complex"}},
        {"format": {}}, {"versions": []}, {"kind": 1},
    ],
    ids=str,
)  # fmt: skip
def test_a_description_with_a_valid_checksum_and_other_entries_is_refused(store, entries):
    run_study(STUDY, store=store)
    manifest = json.loads((store / "study.json").read_text()) | entries
    del manifest["crc32"]
    manifest["crc32"] = f"{crc32(json.dumps(manifest, sort_keys=True).encode()):08x}"
    (store / "study.json").write_text(json.dumps(manifest))
    for read in (mi.load, lambda store: run_study(STUDY, store=store)):
        with pytest.raises(mi.InvalidFile, match=r"study.json is damaged"):
            read(store)


@pytest.mark.parametrize("study", [STUDY, CHAINED], ids=str)
@pytest.mark.parametrize("kind", ["other study", "other points", "other axis"])
def test_a_chunk_from_elsewhere_is_refused(tmp_path, study, kind):
    """The axis of a map has many values, which differ in the last one only."""
    values = [0.1 * i for i in range(1000)]
    study = replace(study, extra={"x": values})
    other = replace(study, seed=2) if kind == "other study" else study
    if kind == "other axis":
        other = replace(study, extra={"x": [*values[:-1], 0.5]})
    stores = [tmp_path / "one", tmp_path / "two"]
    for each, store in zip((study, other), stores, strict=True):
        run_study(each, store=store, chunk=5)
    first, second = (stores[0] / "points" / name for name in chunks(stores[0])[:2])
    content = second.read_bytes()
    foreign = first if kind == "other points" else stores[1] / "points" / second.name
    second.write_bytes(foreign.read_bytes())
    for read in (mi.load, lambda store: run_study(study, store=store)):
        with pytest.raises(mi.InvalidFile, match="another study, or other points") as caught:
            read(stores[0])
        assert caught.value.path == str(second)
    second.write_bytes(content)
    assert bits(mi.load(stores[0]).table) == bits(run_study(study))


def test_a_pipe_in_place_of_a_file(store):
    run_study(STUDY, store=store)
    for path in (store / "points" / chunks(store)[1], store / "study.json"):
        content = path.read_bytes()
        path.unlink()
        os.mkfifo(path)
        for read in (mi.load, lambda store: run_study(STUDY, store=store)):
            with pytest.raises(mi.InvalidFile, match="is a pipe, a socket or a device"):
                read(store)
        assert path.is_fifo()
        path.unlink()
        path.write_bytes(content)


def test_a_completed_store_is_only_read(store):
    expected = bits(run_study(STUDY, store=store))
    (store / "lock").unlink()
    folders = (store, store / "points")
    before = [folder.stat().st_mtime_ns for folder in folders]
    assert bits(run_study(STUDY, store=store)) == expected
    assert [folder.stat().st_mtime_ns for folder in folders] == before


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (Toy(size=30, seed=2), "seed is 1 there, 2 here;"),
        (Toy(size=31), "size is 30 there, 31 here;"),
        (Toy(size=31, seed=2), r"seed is 1 there, 2 here \(and size differ\);"),
        (Toy(size=30, extra={"x": [1.0]}), r"x is 'nothing' there, \[1.0\] here;"),
    ],
)
def test_a_store_of_another_study_is_refused(store, other, told):
    run_study(Toy(size=30), store=store)
    with pytest.raises(mi.InvalidFile, match=f"holds another study: {told}"):
        run_study(other, store=store)


def test_a_difference_is_named_where_it_is(store):
    values = [i / 7 for i in range(1000)]
    options = {"method": "adams", "rtol": 1e-8}
    run_study(Toy(extra={"options": options, "x": ["amplitude", values]}), store=store)
    other = Toy(extra={"options": {**options, "rtol": 1e-9}, "x": ["amplitude", values]})
    with pytest.raises(mi.InvalidFile, match=r"options.rtol is 1e-08 there, 1e-09 here;"):
        run_study(other, store=store)
    values = [*values[:999], 0.5]
    other = Toy(extra={"options": options, "x": ["amplitude", values]})
    with pytest.raises(mi.InvalidFile, match=r"x\[1\]\[999\] is 142.71\d* there, 0.5 here;"):
        run_study(other, store=store)


def test_a_directory_with_something_else_is_refused(tmp_path):
    (tmp_path / "letters.txt").write_text("a")
    with pytest.raises(mi.InvalidFile, match=r"holds no study, but letters.txt; give a new"):
        run_study(STUDY, store=tmp_path)
    assert os.listdir(tmp_path) == ["letters.txt"]


def test_chunks_of_an_unknown_study_are_not_adopted(store):
    run_study(STUDY, store=store)
    (store / "study.json").unlink()
    with pytest.raises(mi.InvalidFile, match=r"holds no study, but points/0.*; give a new"):
        run_study(Toy(size=STUDY.size, seed=STUDY.seed + 1), store=store)


def test_what_the_study_is_outlasts_a_loss_of_power(store, monkeypatch):
    kept = []
    monkeypatch.setattr(os, "fsync", lambda file: kept.append(os.fstat(file).st_ino))
    run_study(STUDY, store=store)
    assert kept == [(store / "study.json").stat().st_ino]


@pytest.mark.parametrize("content", [None, "{", "[]", '{"format": 99}', "{}"])
def test_what_is_no_study_cannot_be_read(tmp_path, content):
    if content is not None:
        (tmp_path / "study.json").write_text(content)
    with pytest.raises(mi.InvalidFile, match="holds no study"):
        mi.load(tmp_path)


def rewrite(store, **changes):
    """Change entries of the manifest, with its checksum."""
    manifest = json.loads((store / "study.json").read_text()) | changes
    del manifest["crc32"]
    checksum = f"{crc32(json.dumps(manifest, sort_keys=True).encode()):08x}"
    (store / "study.json").write_text(json.dumps({**manifest, "crc32": checksum}))


@pytest.mark.parametrize(
    ("number", "remedy"),
    [(99, "update mems_impact"), (1, "run the study again in a new directory")],
)
def test_another_format_is_refused(store, number, remedy):
    run_study(STUDY, store=store)
    rewrite(store, format=number)
    with pytest.raises(mi.InvalidFile, match=rf"has format {number} .*; {remedy}"):
        run_study(STUDY, store=store)
    with pytest.raises(mi.InvalidFile, match=rf"has format {number} .*; {remedy}"):
        mi.load(store)


def test_a_full_disk_leaves_the_chunks_before(store):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(done):
        if done >= 10:  # no file may be longer: writing fails as on a full disk
            resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))

    try:
        with pytest.raises(mi.FileNotWritten, match=r"parquet: cannot be written .*; make room"):
            run_study(STUDY, store=store, progress=fill, workers=1, chunk=3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert 9 <= mi.load(store).done < 30
    assert bits(run_study(STUDY, store=store)) == bits(run_study(STUDY))


def test_a_place_where_no_directory_can_stand(tmp_path):
    (tmp_path / "file").write_text("a")
    for place in (tmp_path / "file", tmp_path / "file" / "store"):
        with pytest.raises(mi.InvalidFile, match="cannot be written"):
            run_study(STUDY, store=place)


@pytest.mark.slow
def test_a_second_process_is_refused_and_readers_are_not(forking, store):
    quick = Toy(size=1000)
    process = forking.Process(target=keep_computing, args=(replace(quick, each=0.05), store))
    process.start()
    wait_until(process, store, 8)
    told = f"is in use by process {process.pid} on "
    with pytest.raises(mi.InvalidFile, match=f"{store}: {told}"):
        run_study(quick, store=store)
    seen = mi.load(store)
    assert 8 <= seen.done == len(seen.table) < 1000
    process.kill()
    process.join()
    assert bits(run_study(quick, store=store)) == bits(run_study(quick))


def test_a_second_study_in_one_process_is_refused(store):
    def again(done):
        run_study(STUDY, store=store)

    with pytest.raises(mi.InvalidFile, match="in use by another study in this process"):
        run_study(STUDY, store=store, progress=again)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_a_file_system_without_locks(store, monkeypatch, caplog, number):
    def refuse(file, operation):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    assert bits(run_study(STUDY, store=store)) == bits(run_study(STUDY))
    assert f"lock: cannot be locked ({os.strerror(number).lower()})" in caplog.text
    assert sorted(path.name for path in store.iterdir()) == ["lock", "points", "study.json"]


def hold_with_a_worker(forking, path, said):
    """Hold a lock, with a forked worker that lives on, until killed."""
    with locking.locked(path):
        worker = forking.Process(target=time.sleep, args=(60.0,))
        worker.start()
        said.put(worker.pid)
        time.sleep(60.0)


def test_a_lock_ends_with_its_process_though_its_workers_live(forking, tmp_path):
    path, said = tmp_path / "lock", forking.Queue()
    process = forking.Process(target=hold_with_a_worker, args=(forking, path, said))
    process.start()
    worker = said.get()
    try:
        with (
            pytest.raises(mi.InvalidFile, match=f"by process {process.pid} on "),
            locking.locked(path),
        ):
            pass
        process.kill()
        process.join()
        os.kill(worker, 0)  # alive
        with locking.locked(path) as alone:
            assert alone
    finally:
        os.kill(worker, signal.SIGKILL)


@pytest.mark.slow
def test_the_modules_of_studies_import_where_there_is_no_fcntl():
    code = "import sys; sys.modules['fcntl'] = None; import mems_impact.studies.engine.store"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_other_versions_are_reported(store, caplog):
    broken_off(STUDY, store, 10, chunk=3)
    rewrite(store, versions={**mi.load(store).attrs["versions"], "numpy": "1.26.0"})
    run_study(STUDY, store=store)
    assert "numpy is '1.26.0' there" in caplog.text


def test_other_programs_read_the_chunks(store):
    import pandas as pd

    table = run_study(STUDY, store=store)
    read = pd.read_parquet(store / "points")
    assert read["number"].tolist() == pytest.approx(table["number"].tolist(), nan_ok=True)


def test_without_pyarrow_it_is_said_how_to_get_it(store, monkeypatch):
    monkeypatch.setattr(parquet, "find_spec", lambda name: None)
    remedy = r"pip install 'mems-impact\[parquet\]'"
    with pytest.raises(mi.InvalidParameter, match=remedy):
        run_study(STUDY, store=store)
    assert not store.exists()
    store.mkdir(parents=True)
    with pytest.raises(mi.InvalidParameter, match=remedy):
        mi.load(store)

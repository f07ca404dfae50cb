"""Files stand whole or not at all."""

import errno
import os
import socket
import stat
from concurrent.futures import ThreadPoolExecutor

import pytest

from mems_impact._util.files import opened, replacing
from mems_impact.errors import FileNotWritten, InvalidFile, InvalidParameter


@pytest.fixture
def file(tmp_path):
    (tmp_path / "table.csv").write_text("old")
    return tmp_path / "table.csv"


def names(file):
    return [path.name for path in file.parent.iterdir()]


def test_the_new_file_appears_when_it_is_whole(file):
    with replacing(file) as temporary:
        temporary.write_text("new")
        assert temporary.suffix == ".csv"
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert names(file) == ["table.csv"]


def begun(file, error):
    with replacing(file) as temporary:
        temporary.write_text("ne")
        raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("a bug")])
def test_what_stood_there_stays(file, error):
    with pytest.raises(type(error)):
        begun(file, error)
    assert file.read_text() == "old"
    assert names(file) == ["table.csv"]


def test_a_full_disk_is_said(file):
    with pytest.raises(FileNotWritten) as caught:
        begun(file, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert str(caught.value).startswith(f"{file}: cannot be written (no space left on device); ")
    assert caught.value.path == str(file)
    assert file.read_text() == "old"
    assert names(file) == ["table.csv"]


def test_a_wrong_place(tmp_path):
    for place in (tmp_path, tmp_path / "none" / "table.csv"):
        with pytest.raises(InvalidFile, match="cannot be written"), replacing(place) as temporary:
            temporary.write_text("new")
    assert list(tmp_path.iterdir()) == []


def test_a_link_is_followed_and_rights_are_kept(file):
    file.chmod(0o604)
    link = file.with_name("link.csv")
    link.symlink_to(file)
    with replacing(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert stat.S_IMODE(file.stat().st_mode) == 0o604


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
def test_a_protected_file_is_not_replaced(file):
    file.chmod(0o400)
    with pytest.raises(InvalidFile, match="permission denied"), replacing(file) as temporary:
        temporary.write_text("new")
    assert file.read_text() == "old"


def write(place, text="new"):
    with replacing(place) as temporary:
        temporary.write_text(text)


def test_a_pipe_and_a_socket_stay(tmp_path):
    pipe, port = tmp_path / "pipe", tmp_path / "socket"
    os.mkfifo(pipe)
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(port))
        for node in (pipe, port, "/dev/null"):
            with pytest.raises(InvalidFile, match="is a pipe, a socket or a device"):
                write(node)
            with pytest.raises(InvalidFile, match="is a pipe"), opened(node, "give a file"):
                pass
    assert pipe.is_fifo()
    assert port.is_socket()


@pytest.mark.parametrize("name", ["a" * 256, "file/a", "loop", "loop/a", "none/a", "link"])
def test_an_impossible_path_is_one_error(tmp_path, name):
    (tmp_path / "file").write_text("old")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "link").symlink_to(tmp_path / "none" / "a")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(InvalidFile, match=r"cannot be written \(.*\); give another place"):
        write(tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.parametrize("name", ["a\0b", "\ud800", b"a", 3, None])
def test_a_value_that_is_no_path_is_an_error(name):
    with pytest.raises(InvalidParameter, match="must be the path of a file"):
        write(name)
    with pytest.raises(InvalidParameter), opened(name, "give a file"):
        pass


def test_the_longest_name_is_written(tmp_path):
    write(tmp_path / ("a" * 255))
    assert (tmp_path / ("a" * 255)).read_text() == "new"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="takes another user")
def test_a_folder_without_search_right(file):
    file.parent.chmod(0o600)
    os.seteuid(65534)  # nobody
    try:
        with pytest.raises(InvalidFile, match="permission denied"):
            write(file)
    finally:
        os.seteuid(0)


def test_threads_write_one_file(file):
    texts = [str(number) * 100_000 for number in range(10)]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda text: write(file, text), texts))
    assert file.read_text() in texts
    assert names(file) == ["table.csv"]

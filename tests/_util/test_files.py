"""Files stand whole or not at all."""

import errno
import os
import stat

import pytest

from mems_impact._util.files import replacing
from mems_impact.errors import FileNotWritten, InvalidFile


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

from typing import NamedTuple

import pytest

from mems_impact.cli import main


class Done(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def cli(capsys, tmp_path, monkeypatch):
    """Run the command line in an empty directory; return status and what was shown."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as end:
            main([str(argument) for argument in arguments])
        return Done(end.value.code, *capsys.readouterr())

    return run

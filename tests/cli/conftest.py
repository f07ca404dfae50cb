from typing import NamedTuple

import pytest

from mems_impact.cli import main


class Done(NamedTuple):
    status: int
    out: str
    err: str

    def complaint(self):
        """Return the one line by which the command refused its input."""
        assert self.status == 2
        assert self.out == ""
        assert self.err.startswith("mems-impact: ")
        assert self.err.count("\n") == 1
        return self.err


@pytest.fixture
def cli(capsys, tmp_path, monkeypatch):
    """Run the command line in an empty directory; return status and what was shown."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as end:
            main([str(argument) for argument in arguments])
        return Done(end.value.code, *capsys.readouterr())

    return run

"""Commands of the program, run in this process."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from pvdf_fem.cli import main as cli


@dataclass(frozen=True)
class Run:
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str

    @classmethod
    def of(cls, arguments: tuple[object, ...], capsys: Any) -> Run:
        try:
            code = cli.main([str(argument) for argument in arguments])
        except SystemExit as exit_:  # of argparse
            code = exit_.code
        return cls(code, *capsys.readouterr())

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    @property
    def told(self) -> list[str]:
        """Keys with values, options or files that standard error names, one in each line."""
        return [line.partition(": ")[0] for line in self.err.splitlines()]

    @property
    def mistakes(self) -> list[str]:
        """What is told by a run that refuses its input."""
        assert (self.code, self.out) == (2, "")
        return self.told

"""Running ngspring's commands in the tests' own process."""

from __future__ import annotations

import os
from pathlib import Path

from click.testing import CliRunner, Result

import ngspring
from ngspring.cli.main import cli


def environment() -> dict[str, str]:
    """For processes that shall import the same ngspring as the tests."""
    return {**os.environ, "PYTHONPATH": str(Path(ngspring.__file__).parents[1])}


def invoke(*args: object, code: int = 0) -> Result:
    """Run ``ngspring ARGS`` and check its exit code; unexpected exceptions pass through."""
    result = CliRunner().invoke(cli, [str(arg) for arg in args], prog_name="ngspring")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == code, result.output
    return result

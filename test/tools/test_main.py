"""The command line of the package itself."""

import subprocess
import sys

import pytest

from phd_jdtc_ros import __main__ as package
from phd_jdtc_ros.__main__ import EXECUTABLES


@pytest.fixture
def start(monkeypatch, capsys):
    """Return a function that runs ``python -m phd_jdtc_ros``: status, output and errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["phd_jdtc_ros", *arguments])
        try:
            status = package.main()
        except SystemExit as end:  # of argparse
            status = end.code
        return status, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["no_such_node"], "unknown executable 'no_such_node'\n"),
        (["no_such_node", "--help"], "unknown executable 'no_such_node'\n"),
        ([], ""),
        (["-h"], None),
        (["--help"], None),
    ],
)
def test_usage_is_printed_unless_an_executable_is_named(start, arguments, refusal):
    status, out, err = start(*arguments)
    assert status == (0 if refusal is None else 2)
    text, other = (out, err) if refusal is None else (err, out)
    assert other == ""
    assert text.startswith(f"{refusal or ''}usage: python -m phd_jdtc_ros NAME [ARGUMENTS]\n")
    for name in EXECUTABLES:
        assert f"\n  {name} " in text


@pytest.mark.parametrize("name", ["simulate", "track_bag", "demo"])
def test_help_of_an_offline_executable_names_its_arguments(start, name):
    status, out, err = start(name, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(f"usage: {name} ")
    assert "--out" in out
    assert "NAME:=VALUE" in out
    assert "`" not in out  # names of modules are for those who read the code


def test_an_executable_passes_its_status_on(tmp_path):
    done = subprocess.run(
        [
            *(sys.executable, "-m", "phd_jdtc_ros", "track_bag"),
            *(tmp_path / "none", "--out", tmp_path / "out"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"track_bag: {tmp_path / 'none'}: no such bag\n"

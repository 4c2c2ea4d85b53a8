import subprocess
import sys

import pytest

from phd_jdtc_ros.__main__ import EXECUTABLES


def start(*arguments):
    done = subprocess.run(
        [sys.executable, "-m", "phd_jdtc_ros", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def assert_usage(text):
    assert "usage: python -m phd_jdtc_ros NAME [ARGUMENTS]" in text
    for name in EXECUTABLES:
        assert f"\n  {name} " in text


@pytest.mark.parametrize("arguments", [["no_such_node"], ["no_such_node", "--help"]])
def test_an_unknown_executable_is_refused_with_the_usage(arguments):
    status, out, err = start(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith("unknown executable 'no_such_node'\n")
    assert_usage(err)


def test_no_executable_is_refused_with_the_usage():
    status, out, err = start()
    assert (status, out) == (2, "")
    assert_usage(err)


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_is_the_usage(flag):
    status, out, err = start(flag)
    assert (status, err) == (0, "")
    assert_usage(out)


@pytest.mark.parametrize("name", ["simulate", "track_bag", "demo"])
def test_help_of_an_offline_executable_names_its_arguments(name):
    status, out, err = start(name, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(f"usage: {name} ")
    assert "--out" in out
    assert "NAME:=VALUE" in out
    assert "`" not in out  # names of modules are for those who read the code


def test_an_executable_passes_its_status_on(tmp_path):
    status, out, err = start("track_bag", str(tmp_path / "none"), "--out", str(tmp_path / "out"))
    assert (status, out) == (2, "")
    assert err == f"track_bag: {tmp_path / 'none'}: no such bag\n"

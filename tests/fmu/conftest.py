"""Tests of FMUs compare short runs with the interpreter: an FMU has its own binary."""

import functools
from unittest import mock

import pytest

from insenv.fmu import export_fmu


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")


@pytest.fixture(scope="session")
def bare(tmp_path_factory):
    """A function that exports an FMU without binaries, the same one once."""

    @functools.cache
    def exported(what, fmi=2, **options):
        with mock.patch("insenv.fmu.exporter.build", lambda *arguments: {}):
            return export_fmu(what, tmp_path_factory.mktemp("bare") / "x.fmu", fmi=fmi, **options)

    return exported

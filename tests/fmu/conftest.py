"""Tests of FMUs compare short runs with the interpreter: an FMU has its own binary."""

from unittest import mock

import pytest
from interpreted import interpreted  # noqa: F401

from insenv.fmu import export_fmu


@pytest.fixture(scope="session")
def bare(tmp_path_factory):
    """A function that exports an FMU without binaries, the same one once."""
    made = {}

    def exported(what, fmi=2, **options):
        key = repr((what, fmi, options))
        if key not in made:
            with mock.patch("insenv.fmu.exporter.build", lambda *arguments: {}):
                made[key] = export_fmu(what, tmp_path_factory.mktemp("bare") / "x.fmu", fmi=fmi, **options)
        return made[key]

    return exported

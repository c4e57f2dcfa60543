"""The sources of an FMU: two of them in one program, without warnings, with the importer's headers."""

import subprocess

import pytest
from fmu_tools import c_compiler, exported, scratch, unzipped

from insenv.core.compile import find_compiler
from insenv.files.resources import fmu_folder
from insenv.fmu import export_fmu

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler found")

WARNINGS = ["-Wall", "-Wextra", "-pedantic", "-Werror"]
IDS = ("qakf-improved", "loosely-coupled", "ship-underway")


def compiled(id, fmi, *options):
    """The object file of an FMU's sources, with the headers of the standard from elsewhere."""
    made = scratch() / f"{id}-{fmi}.o"
    source = unzipped(id, fmi) / "sources" / f"fmi{fmi}.c"
    command = [c_compiler(), "-std=c99", *options, f"-I{fmu_folder() / 'headers'}", "-c", str(source), "-o", str(made)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:4000]
    return made


@pytest.mark.parametrize("fmi", (pytest.param(2, marks=pytest.mark.slow), 3))
@pytest.mark.parametrize("id", IDS)
def test_the_compiler_has_no_warnings(id, fmi):
    assert compiled(id, fmi, "-O1", *WARNINGS).stat().st_size > 1000


@pytest.mark.parametrize("fmi", (2, 3))
def test_two_fmus_are_linked_into_one_program(fmi):
    objects = [str(compiled(id, fmi, "-O0")) for id in IDS[:2]]
    main = scratch() / f"two-{fmi}.c"
    main.write_text(
        f"const char *qakf_improved_fmi{fmi}GetVersion(void);\nconst char *loosely_coupled_fmi{fmi}GetVersion(void);\n"
        f"int main(void) {{ return qakf_improved_fmi{fmi}GetVersion()[0] != '{fmi}'\n"
        f"                      || loosely_coupled_fmi{fmi}GetVersion()[0] != '{fmi}'; }}\n"
    )
    binary = main.with_suffix("")
    done = subprocess.run([c_compiler(), str(main), *objects, "-lm", "-o", str(binary)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    subprocess.run([str(binary)], check=True)


def test_scalars_of_fmi_3_have_the_values_of_arrays():
    import numpy as np
    from fmu_tools import columns_for

    from insenv.fmu import run

    columns = columns_for("loosely-coupled", 400)
    path = export_fmu("loosely-coupled", scratch() / "scalars.fmu", fmi=3, arrays=False)
    found, arrays = run(path, columns), run(exported("loosely-coupled", 3), columns)
    assert found.names == arrays.names
    np.testing.assert_array_equal(found.values, arrays.values)

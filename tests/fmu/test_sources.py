"""The sources of an FMU: two of them in one program, without warnings, with the importer's headers."""

import subprocess

import numpy as np
import pytest
from fmu_tools import c_compiler, columns_for, exported, scratch, unzipped

from insenv.files.resources import fmu_folder
from insenv.fmu import export_fmu, run

WARNINGS = ["-Wall", "-Wextra", "-pedantic", "-Werror"]


def compiled(id, fmi, *options):
    """The object file of an FMU's sources, with the headers of the standard from elsewhere."""
    made = scratch() / f"{id}-{fmi}.o"
    source = unzipped(id, fmi) / "sources" / f"fmi{fmi}.c"
    flags = ["-std=c99", *options, *WARNINGS, f"-I{fmu_folder() / 'headers'}", "-c"]
    done = subprocess.run([c_compiler(), *flags, str(source), "-o", str(made)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:4000]
    return made


@pytest.mark.slow
@pytest.mark.parametrize("fmi", (2, 3))
@pytest.mark.parametrize("id", ("qakf-improved", "lssvm", "car-parked", "loosely-coupled", "ship-underway"))
def test_an_optimising_compiler_has_no_warnings(id, fmi):
    assert compiled(id, fmi, "-O1").stat().st_size > 1000


@pytest.mark.parametrize(("fmi", "ids"), [(2, ("qakf_improved", "lssvm")), (3, ("qakf_improved", "car_parked"))])
def test_two_fmus_are_compiled_without_warnings_and_linked_into_one_program(fmi, ids):
    objects = [str(compiled(id.replace("_", "-"), fmi, "-O0")) for id in ids]
    main = scratch() / f"two-{fmi}.c"
    declared = "".join(f"const char *{id}_fmi{fmi}GetVersion(void);\n" for id in ids)
    right = " && ".join(f"{id}_fmi{fmi}GetVersion()[0] == '{fmi}'" for id in ids)
    main.write_text(f"{declared}int main(void) {{ return !({right}); }}\n")
    binary = main.with_suffix("")
    subprocess.run([c_compiler(), str(main), *objects, "-lm", "-o", str(binary)], check=True)
    subprocess.run([str(binary)], check=True)


def test_scalars_of_fmi_3_have_the_values_of_arrays():
    columns = columns_for("qakf-improved", 100)
    path = export_fmu("qakf-improved", scratch() / "scalars.fmu", fmi=3, arrays=False)
    found, arrays = run(path, columns), run(exported("qakf-improved", 3), columns)
    assert found.names == arrays.names
    np.testing.assert_array_equal(found.values, arrays.values)

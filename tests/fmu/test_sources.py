"""The sources of FMUs, with the importer's headers."""

import subprocess

import pytest
from fmu_tools import LOOP, c_compiler, scratch, subject_of, unzipped

from insenv.base.resources import fmu_folder

ID, WARNINGS = "qakf-improved", ["-Wall", "-Wextra", "-pedantic", "-Werror"]


@pytest.mark.parametrize(("fmi", "other"), [(2, "ship-swaying"), pytest.param(3, LOOP, marks=pytest.mark.slow)])
def test_two_fmus_are_compiled_without_warnings_and_linked_into_one_program(fmi, other):
    main, objects = scratch() / f"two-{fmi}.c", []
    ids = [subject_of(each).identifier for each in (ID, other)]
    for what, id, level in zip((ID, other), ids, ("-O1", "-O0"), strict=True):
        objects.append(str(scratch() / f"{id}-{fmi}.o"))
        source = unzipped(what, fmi) / "sources" / f"fmi{fmi}.c"
        flags = ["-std=c99", level, *WARNINGS, f"-I{fmu_folder() / 'headers'}", "-c"]
        subprocess.run([c_compiler(), *flags, str(source), "-o", objects[-1]], check=True)
    declared = "".join(f"const char *{id}_fmi{fmi}GetVersion(void);\n" for id in ids)
    right = " && ".join(f"{id}_fmi{fmi}GetVersion()[0] == '{fmi}'" for id in ids)
    main.write_text(f"{declared}int main(void) {{ return !({right}); }}\n")
    binary = main.with_suffix("")
    subprocess.run([c_compiler(), str(main), *objects, "-lm", "-o", str(binary)], check=True)
    subprocess.run([str(binary)], check=True)

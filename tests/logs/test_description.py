"""Wrong keys and values of the description of a log (each by itself: tests/cli/wrong_calls.toml)."""


def test_a_reference_without_columns_is_named(folder):
    folder.toml += '[reference]\nfile = "r.csv"\ntime = "t"\n'
    folder.error("give the columns of position, velocity or attitude")


def test_all_faults_of_the_files_are_listed_at_once_with_those_of_the_keys(folder):
    (folder.path / "gnss.csv").unlink()
    folder.change(('"gx", "gy"', '"wx", "wy"'), ('kind = "rate"', 'kind = "foo"'))
    folder.toml += '[reference]\nfile = ["a.csv", "b.csv"]\ntime = "t"\nvelocity = ["n", "e", "d"]\n'
    files = [f"{name}.csv: file not found" for name in ("gnss", "a", "b")]
    folder.error("no column 'wx'", "no column 'wy'", "imu.kind = 'foo'", *files)

"""Files are written completely or not at all."""

import stat

import pytest

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import atomic, check_output_file, staged


def test_a_failed_block_leaves_the_file_unchanged(tmp_path):
    path = tmp_path / "file"
    with atomic(path) as stream:
        stream.write(b"first")
    with pytest.raises(KeyboardInterrupt), atomic(path) as stream:
        stream.write(b"second")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"first" and list(tmp_path.iterdir()) == [path]


def test_permissions_follow_the_umask_unless_private(tmp_path):
    (tmp_path / "plain").write_text("")
    for name, private in (("public", False), ("private", True)):
        with atomic(tmp_path / name, private):
            pass
    assert (tmp_path / "public").stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert stat.S_IMODE((tmp_path / "private").stat().st_mode) == 0o600


def test_several_files_appear_together_or_not_at_all_and_a_folder_is_no_file(tmp_path):
    (tmp_path / "b").mkdir()
    with pytest.raises(InsenvError, match=r"b.*is a folder"), staged(tmp_path) as part:
        for name in "ab":
            part(name).write_text(name)
    with pytest.raises(InputError, match="it is a folder"):
        check_output_file(tmp_path)
    check_output_file(tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path):
    left, mine = tmp_path / ".run.npz.ab12_xyz.part", [tmp_path / name for name in (".notes.part", "x.tlog.part", ".a.b")]
    for path in (left, *mine):
        path.write_text("x")
    with staged(tmp_path) as part, staged(tmp_path) as other:  # one process does not remove what another one writes
        for name, make in (("b", part), ("c", other)):
            make(name).write_text(name)
        with staged(tmp_path) as third:
            third("d").write_text("d")
    assert not left.exists() and all(path.exists() for path in mine)
    assert [(tmp_path / name).read_text() for name in "bcd"] == list("bcd")

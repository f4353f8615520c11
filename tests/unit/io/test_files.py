"""A file is written whole or not at all."""

import pytest

from floquid.errors import InputError
from floquid.io import atomic_path, readable_file


def test_the_name_is_taken_at_the_end(tmp_path):
    path = tmp_path / "result.h5"
    path.write_text("old")
    with atomic_path(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".h5"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [KeyError("x"), RuntimeError("x"), KeyboardInterrupt()])
def test_a_failure_leaves_what_was_there(tmp_path, error):
    path = tmp_path / "result.h5"
    path.write_text("old")

    def fail(temporary):
        temporary.write_text("half")
        raise error

    with pytest.raises(type(error)), atomic_path(path) as temporary:
        fail(temporary)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_an_input_error(tmp_path):
    with (
        pytest.raises(InputError, match=r"`out` of `save` must be a path that can be written, but .*No space"),
        atomic_path(tmp_path / "result.h5", of="save", argument="out"),
    ):
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_an_input_error_of_the_block_passes(tmp_path):
    with pytest.raises(InputError, match=r"^mine$"), atomic_path(tmp_path / "result.h5"):
        raise InputError("mine")
    assert not list(tmp_path.iterdir())


def test_a_link_keeps_pointing_at_its_file(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    link = tmp_path / "link.txt"
    link.symlink_to("real.txt")
    with atomic_path(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


def test_a_loop_of_links_is_refused(tmp_path):
    link = tmp_path / "link.txt"
    link.symlink_to("link.txt")
    with pytest.raises(InputError), atomic_path(link):
        pytest.fail("the block must not be entered")
    with pytest.raises(InputError, match="cannot be opened"):
        readable_file(link, of="read")


def test_a_folder_that_may_not_be_written_to(tmp_path, monkeypatch):
    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", denied)
    with pytest.raises(InputError, match=r"Permission denied.*\n  Choose a folder"), atomic_path(tmp_path / "a.txt"):
        pytest.fail("the block must not be entered")


def test_a_new_file_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "other").touch()
    with atomic_path(tmp_path / "new") as temporary:
        temporary.write_text("x")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_device_is_not_read():
    with pytest.raises(InputError, match="not a regular file"):
        readable_file("/dev/null", of="read")

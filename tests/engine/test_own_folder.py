"""Caches and locks are this user's own: no links, nothing cut off, and what somebody else made is made again."""

import os
import stat

import numpy as np
import pytest

from bench import own_folder as own
from bench.engine import affinity
from bench.engine.memo import Memo, prune
from bench.plugins import kept


def test_a_folder_counts_where_it_is_this_users_alone(tmp_path, monkeypatch):
    folder = own.own_folder(tmp_path / "a" / "b")
    assert folder == tmp_path / "a" / "b" and stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)
    assert own.own_folder(folder) == folder and stat.S_IMODE(folder.stat().st_mode) == 0o700
    (tmp_path / "link").symlink_to(folder)
    (tmp_path / "file").write_text("")
    assert own.own_folder(tmp_path / "link") is None and own.own_folder(tmp_path / "file") is None
    monkeypatch.setattr(os, "getuid", lambda: 54321)
    assert own.own_folder(folder) is None


def test_a_file_is_not_opened_through_a_link_nor_cut(tmp_path):
    target = tmp_path / "mine.txt"
    target.write_text("all of it")
    (tmp_path / "link").symlink_to(target)
    os.mkfifo(tmp_path / "fifo")
    for name in ("link", "fifo"):
        with pytest.raises(OSError):
            os.close(own.open_own(tmp_path / name, os.O_RDWR))
    os.close(own.open_own(target, os.O_RDWR))
    assert target.read_text() == "all of it"
    for name in ("fifo", "."):
        with pytest.raises(OSError):
            own.read_regular(tmp_path / name)
    assert own.read_regular(tmp_path / "link") == b"all of it"


def test_checkouts_that_share_an_environment_keep_a_listing_each(tmp_path, monkeypatch):
    """With one for both, each would make it anew after every start of the other."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept.keep("here", {"plugins": {}, "broken": []})
    monkeypatch.setattr(kept, "__file__", "/elsewhere/bench/plugins/kept.py")
    kept.keep("there", {"plugins": {}, "broken": []})
    assert kept.kept_listing("there") and not kept.kept_listing("here")
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert kept.kept_listing("here")


def test_locks_and_listings_in_a_folder_of_somebody_else_are_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    listing = {"plugins": {}, "broken": []}
    kept.keep("stamp", listing)
    assert kept.kept_listing("stamp") == listing
    me = os.getuid()
    with affinity.hold("x"), affinity.hold("x") as free:
        assert not free and (tmp_path / f"detailbench-cpus-{me}" / "x").exists()
    monkeypatch.setattr(os, "getuid", lambda: me + 1)
    kept.keep("other", listing)
    assert kept.kept_listing("stamp") is None and kept.kept_listing("other") is None
    (tmp_path / f"detailbench-cpus-{me + 1}").symlink_to(tmp_path)
    with affinity.hold("x"), affinity.hold("x") as free:
        assert free
    assert not (tmp_path / "x").exists()


# -- arrays that cells share -------------------------------------------------------------------------------------------


@pytest.fixture
def memo(tmp_path):
    return Memo(tmp_path / ".cache", "a key")


def entry(memo: Memo, name: str, value: float) -> np.ndarray:
    return memo.arrays(name, lambda: {"x": np.full(3, value)})["x"]


def test_arrays_made_by_somebody_else_are_made_again(memo, monkeypatch):
    with monkeypatch.context() as context:
        context.setattr(own, "_key", lambda: b"of somebody else")
        assert entry(memo, "a", 5.0)[0] == entry(memo, "a", 6.0)[0] == 5.0
    assert entry(memo, "a", 7.0)[0] == 7.0
    assert entry(memo, "a", 8.0)[0] == 7.0


def test_arrays_under_the_name_of_others_are_made_again(memo):
    entry(memo, "a", 5.0)
    (first,) = memo.folder.glob("*/*.npz")
    entry(memo, "b", 6.0)
    (second,) = (path for path in memo.folder.glob("*/*.npz") if path != first)
    second.write_bytes(first.read_bytes())
    assert entry(memo, "b", 7.0)[0] == 7.0 and entry(memo, "a", 8.0)[0] == 5.0


def test_the_key_is_one_for_all_processes_and_of_this_user(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = own._key.__wrapped__()
    file = tmp_path / "detailbench" / "key"
    assert made == own._key.__wrapped__() == file.read_bytes() and stat.S_IMODE(file.stat().st_mode) == 0o600
    file.write_bytes(b"torn")
    again = own._key.__wrapped__()
    assert len(again) == own.KEY_SIZE and again == file.read_bytes() != made
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert own._key.__wrapped__() != own._key.__wrapped__()


def test_nothing_but_entries_is_forgotten_wherever_links_lead(tmp_path, memo):
    entry(memo, "a", 1.0)
    (path,) = memo.folder.glob("*/*.npz")
    precious = tmp_path / "home" / "ab" / ("ab" + "0" * 62 + ".npz")
    letter = tmp_path / "home" / "letters" / "love.txt"
    for file in (precious, letter):
        file.parent.mkdir(parents=True)
        file.write_text("dear")
    linked = memo.folder / "ab"
    assert not linked.exists()
    linked.symlink_to(precious.parent)
    (memo.folder / "letters").symlink_to(letter.parent)
    prune(memo.folder, limit_gb=0.0)
    assert precious.exists() and letter.exists() and not path.exists()
    (tmp_path / "link").symlink_to(tmp_path / "home")
    prune(tmp_path / "link", limit_gb=0.0)
    assert letter.exists()

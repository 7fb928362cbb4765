"""The store: crashes, damage, simultaneous writers, a full store, ids of other users."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as some

from jointid import JointIdError, load_study, save_study
from jointid.files import store, store_files
from jointid.files.atomic_write import locked, write_file
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace

ROOT = Path(__file__).parents[1]


@pytest.fixture
def kept(tmp_path: Path) -> Store:
    return Store(tmp_path / "data")


@pytest.fixture
def mine() -> str:
    return new_workspace()


def files(kept: Store, pattern: str) -> list[Path]:
    return sorted(kept.folder.rglob(pattern))


def aged(file: Path, seconds: float) -> None:
    when = time.time() - seconds
    os.utime(file, (when, when))


class TestKeeping:
    def test_a_saved_study_is_read_by_another_store_of_the_folder(self, kept: Store, mine: str) -> None:
        data = bytes(range(256)) * 100
        entry = kept.put(mine, "cell 7.zip", "abc", data)
        other = Store(kept.folder)
        assert [found.id for found in other.entries(mine)] == [entry.id]
        assert other.read(mine, entry.id) == data
        assert (entry.name, entry.digest, entry.size_bytes) == ("cell 7.zip", "abc", len(data))

    def test_no_folder_is_created_before_the_first_study(self, kept: Store, mine: str) -> None:
        assert not kept.known(mine)
        assert kept.entries(mine) == ()
        assert kept.size_bytes() == 0
        assert not kept.folder.exists()

    def test_the_newest_comes_first_and_the_same_study_is_kept_once(
        self, kept: Store, mine: str
    ) -> None:
        for name, digest in (("a", "1"), ("b", "2"), ("a again", "1")):
            kept.put(mine, name, digest, digest.encode())
        assert [entry.name for entry in kept.entries(mine)] == ["a again", "b"]
        assert len(files(kept, "*.data")) == 2

    def test_a_repeated_study_moves_to_the_front_with_its_new_name(self, kept: Store, mine: str) -> None:
        first = kept.put(mine, "a", "1", b"data")
        kept.rename(mine, first.id, "renamed")
        kept.put(mine, "b", "2", b"other")
        again = kept.put(mine, "a again", "1", b"data")
        assert [entry.name for entry in kept.entries(mine)] == ["a again", "b"]
        assert kept.read(mine, again.id) == b"data"

    @pytest.mark.parametrize("there", [b"datA", b"", None])
    def test_other_bytes_of_the_same_digest_replace_what_was_there(
        self, kept: Store, mine: str, there: bytes | None
    ) -> None:
        kept.put(mine, "a", "1", b"data")
        (file,) = files(kept, "*.data")
        file.unlink() if there is None else file.write_bytes(there)
        again = kept.put(mine, "a", "1", b"data")
        assert [entry.id for entry in kept.entries(mine)] == [again.id]
        assert kept.read(mine, again.id) == b"data"

    def test_rename_and_delete(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "a", "1", b"data")
        kept.rename(mine, entry.id, "  axis 2,\nworn ")
        assert [e.name for e in kept.entries(mine)] == ["axis 2, worn"]
        assert kept.read(mine, entry.id) == b"data"
        with pytest.raises(JointIdError, match="name is empty"):
            kept.rename(mine, entry.id, " \n")
        kept.delete(mine, entry.id)
        kept.delete(mine, entry.id)
        assert kept.entries(mine) == ()
        assert files(kept, "*.data") == files(kept, "*.json") == []
        with pytest.raises(JointIdError, match="no longer in the store"):
            kept.rename(mine, entry.id, "b")
        with pytest.raises(JointIdError, match="no longer in the store"):
            kept.read(mine, entry.id)

    def test_reading_counts_as_opening(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "a", "1", b"data")
        aged(files(kept, "*.data")[0], 1e6)
        kept.read(mine, entry.id)
        assert kept.entries(mine)[0].opened_s == pytest.approx(time.time(), abs=60)

    @pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
    def test_other_users_cannot_read_the_store(self, kept: Store, mine: str) -> None:
        kept.put(mine, "a", "1", b"data")
        for file in [*files(kept, "*.data"), *files(kept, "*.json")]:
            assert stat.S_IMODE(file.stat().st_mode) == 0o600
            assert not stat.S_IMODE(file.parent.stat().st_mode) & 0o077


class TestStrangers:
    def test_a_workspace_does_not_list_studies_of_another(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "a", "1", b"data")
        stranger = new_workspace()
        assert kept.entries(stranger) == ()
        with pytest.raises(JointIdError):
            kept.read(stranger, entry.id)
        kept.delete(stranger, entry.id)
        assert kept.read(mine, entry.id) == b"data"

    def test_ids_are_random_and_not_stored_on_disk(self, kept: Store) -> None:
        ids = {new_workspace() for _ in range(1000)}
        assert len(ids) == 1000
        assert all(len(workspace) == 32 for workspace in ids)
        for workspace in list(ids)[:5]:
            kept.put(workspace, "a", "1", b"data")
        everything = " ".join(str(file) for file in files(kept, "*"))
        assert not any(workspace in everything for workspace in ids)

    @given(
        text=some.text() | some.sampled_from(["../" * 8, "..", "/etc/passwd", "a/../../b", "\0", "C:\\"])
    )
    def test_no_id_leads_outside_the_folder(
        self, text: str, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        kept, mine = Store(tmp_path_factory.getbasetemp() / "untouched"), new_workspace()
        assert not kept.known(text)
        for call in (
            lambda: kept.entries(text),
            lambda: kept.put(text, "a", "1", b""),
            lambda: kept.notes(text),
            lambda: kept.read(mine, text),
            lambda: kept.rename(mine, text, "a"),
            lambda: kept.delete(mine, text),
            lambda: kept.dismiss(mine, text),
            lambda: kept.set_aside(mine, text, "a"),
        ):
            with pytest.raises(JointIdError, match="is not the id"):
                call()
        assert not kept.folder.exists()


CRASH = """
import os, sys
from pathlib import Path
from jointid.files.store import Store
real, left = Path.replace, int(sys.argv[3])
def replace(self, target):
    global left
    if left == 0:
        os._exit(9)  # as kill -9: nothing is cleaned up
    left -= 1
    return real(self, target)
Path.replace = replace
Store(Path(sys.argv[1])).put(sys.argv[2], "new", "2", b"new" * 1000)
"""


class TestCrashes:
    @pytest.mark.parametrize("renames", [0, 1], ids=["before the data", "before the commit"])
    def test_between_write_and_rename(self, kept: Store, mine: str, renames: int) -> None:
        entry = kept.put(mine, "old", "1", b"old")
        command = [sys.executable, "-c", CRASH, str(kept.folder), mine, str(renames)]
        assert subprocess.run(command, cwd=ROOT, check=False).returncode == 9
        left = files(kept, "*.new")
        assert len(left) == 1, "the crash came too late to show anything"
        assert [found.id for found in kept.entries(mine)] == [entry.id]
        assert kept.read(mine, entry.id) == b"old"
        assert kept.notes(mine) == {}
        for file in [*left, *files(kept, "*.data")]:
            aged(file, 7200)
        kept.put(mine, "next", "3", b"next")
        assert files(kept, "*.new") == []
        assert len(files(kept, "*.data")) == 2
        assert [e.name for e in kept.entries(mine)] == ["next", "old"]

    def test_a_full_disk_is_reported_and_leaves_no_file(
        self, kept: Store, mine: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def full(_: int) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(store.os, "fsync", full)
        with pytest.raises(JointIdError, match="No space left on device"):
            kept.put(mine, "a", "1", b"data")
        assert [file for file in files(kept, "*") if file.is_file()] == []

    def test_a_folder_that_is_a_file_is_reported(self, tmp_path: Path, mine: str) -> None:
        (tmp_path / "data").write_text("not a folder")
        with pytest.raises(JointIdError, match="JOINTID_DATA_DIR"):
            Store(tmp_path / "data").put(mine, "a", "1", b"data")


class TestDamage:
    @pytest.mark.parametrize(
        ("ending", "content"),
        [
            (".json", b""),
            (".json", b"\xff\xfe"),
            (".json", b"[]"),
            (".json", b"[" * 100_000),
            (".json", b'{"format": 1}'),
            (".data", b""),
            (".data", b"longer than it was"),
            (".data", None),
        ],
    )
    def test_a_damaged_study_is_set_aside_and_reported_once(
        self, kept: Store, mine: str, ending: str, content: bytes | None
    ) -> None:
        good = kept.put(mine, "good", "1", b"good")
        bad = kept.put(mine, "bad", "2", b"bad")
        (file,) = files(kept, f"{bad.id}{ending}")
        if content is None:
            file.unlink()
        else:
            file.write_bytes(content)
        assert [found.id for found in kept.entries(mine)] == [good.id]
        ((entry, note),) = kept.notes(mine).items()
        assert "set aside" in note
        assert len(list((kept.folder / "damaged").iterdir())) == 2 - (content is None)
        kept.dismiss(mine, entry)
        assert kept.notes(mine) == {}
        assert kept.read(mine, good.id) == b"good"

    def test_a_damaged_study_in_a_read_only_store_does_not_hide_others(
        self, kept: Store, mine: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        good, bad = kept.put(mine, "good", "1", b"good"), kept.put(mine, "bad", "2", b"bad")
        (file,) = files(kept, f"{bad.id}.json")
        file.write_bytes(b"{")

        def full(_: Path, __: bytes) -> None:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as disk:
            disk.setattr(store, "write_whole", full)
            assert [found.id for found in kept.entries(mine)] == [good.id]
        assert file.exists()
        assert [found.id for found in kept.entries(mine)] == [good.id]
        assert "was damaged" in "".join(kept.notes(mine).values()), "once it can be written, it is told"

    def test_a_flipped_bit_is_found_when_it_is_read(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "bad", "2", b"0123456789")
        (file,) = files(kept, "*.data")
        file.write_bytes(b"0123456788")
        with pytest.raises(JointIdError, match='"bad" is damaged: its checksum'):
            kept.read(mine, entry.id)
        assert kept.entries(mine) == ()
        assert "bad was damaged" in "".join(kept.notes(mine).values())
        assert (kept.folder / "damaged" / file.name).read_bytes() == b"0123456788"


class TestBound:
    def test_the_least_recently_opened_studies_are_removed_with_a_note(
        self, tmp_path: Path, mine: str
    ) -> None:
        kept = Store(tmp_path, limit_bytes=50_000)
        other = new_workspace()
        old = [kept.put(who, f"{k}", f"{k}", bytes(10_000)) for k, who in enumerate([mine, other, mine])]
        for age, entry in zip((300, 500, 400), old, strict=True):
            aged(files(kept, f"{entry.id}.data")[0], age)
        kept.put(mine, "large", "large", bytes(30_000))
        assert kept.size_bytes() <= 50_000
        assert [entry.name for entry in kept.entries(mine)] == ["large", "0"]
        assert kept.entries(other) == ()
        assert ["1 was deleted" in note for note in kept.notes(other).values()] == [True]
        assert ["2 was deleted" in note for note in kept.notes(mine).values()] == [True]

    def test_damaged_files_are_removed_before_any_study(self, tmp_path: Path, mine: str) -> None:
        kept = Store(tmp_path, limit_bytes=50_000)
        bad = kept.put(mine, "bad", "1", bytes(20_000))
        good = kept.put(mine, "good", "2", bytes(20_000))
        kept.set_aside(mine, bad.id, "a test")
        kept.put(mine, "new", "3", bytes(20_000))
        assert good.id in [found.id for found in kept.entries(mine)]
        assert not list((tmp_path / "damaged").glob("*.data"))

    def test_a_study_larger_than_the_store_is_refused_and_no_other_removed(
        self, tmp_path: Path, mine: str
    ) -> None:
        kept = Store(tmp_path, limit_bytes=10_000)
        entry = kept.put(mine, "small", "1", b"small")
        with pytest.raises(JointIdError, match="the store holds"):
            kept.put(mine, "large", "2", bytes(10_001))
        assert [found.id for found in kept.entries(mine)] == [entry.id]


WRITER = """
import sys
from pathlib import Path
from jointid.files.store import Store
kept, who = Store(Path(sys.argv[1])), int(sys.argv[3])
for k in range(15):
    kept.put(sys.argv[2], f"{who} {k}", f"{who} {k}", bytes([who]) * (1000 + k))
    kept.entries(sys.argv[2])
"""


class TestManyAtOnce:
    def test_processes_that_write_one_workspace_lose_nothing(self, kept: Store, mine: str) -> None:
        command = [sys.executable, "-c", WRITER, str(kept.folder), mine]
        writers = [subprocess.Popen([*command, str(who)], cwd=ROOT) for who in range(3)]
        assert [writer.wait(timeout=60) for writer in writers] == [0, 0, 0]
        entries = kept.entries(mine)
        assert {entry.name for entry in entries} == {f"{w} {k}" for w in range(3) for k in range(15)}
        for entry in entries:
            who, k = map(int, entry.name.split())
            assert kept.read(mine, entry.id) == bytes([who]) * (1000 + k)
        assert kept.notes(mine) == {}

    def test_threads_that_put_rename_list_and_delete_find_no_damage(
        self, kept: Store, mine: str
    ) -> None:
        def work(who: int) -> None:
            for k in range(25):
                entry = kept.put(mine, f"{who} {k}", f"{who} {k}", b"x" * 100)
                for listed in kept.entries(mine)[:3]:
                    with suppress(JointIdError):  # another thread deleted it
                        kept.rename(mine, listed.id, "renamed")
                        assert kept.read(mine, listed.id) == b"x" * 100
                kept.delete(mine, entry.id)

        with ThreadPoolExecutor(6) as threads:
            list(threads.map(work, range(6)))
        assert kept.entries(mine) == ()
        assert kept.notes(mine) == {}
        assert not (kept.folder / "damaged").exists()
        assert files(kept, "*.new") == []


class TestNames:
    def test_a_damaged_name_is_replaced(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "first name", "1", b"data")
        kept.rename(mine, entry.id, "second name")
        (renamed,) = files(kept, "*.name")
        renamed.write_bytes(renamed.read_bytes().replace(b"second", b"secand"))
        assert [e.name for e in kept.entries(mine)] == ["first name"]
        (described,) = files(kept, "*.json")
        described.write_bytes(described.read_bytes().replace(b"first", b"firzt"))
        assert kept.entries(mine) == ()
        assert "was damaged" in "".join(kept.notes(mine).values())

    def test_entries_without_a_checksum_of_the_name_are_read(self, kept: Store, mine: str) -> None:
        entry = kept.put(mine, "old", "1", b"data")
        (described,) = files(kept, "*.json")
        plain = json.loads(described.read_bytes())
        del plain["seal"]
        described.write_text(json.dumps(plain))
        described.with_suffix(".name").write_text("renamed before")
        assert [e.name for e in kept.entries(mine)] == ["renamed before"]
        assert kept.read(mine, entry.id) == b"data"


@pytest.mark.skipif(sys.platform != "linux", reason="the folders of Linux")
@pytest.mark.parametrize("home", ["", "relative/home"])
def test_the_folder_of_a_user_without_a_home_is_absolute(
    home: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("JOINTID_DATA_DIR", raising=False)
    monkeypatch.setenv("HOME", home)
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    import pwd

    assert store_files.user_folder() == Path(pwd.getpwuid(os.getuid()).pw_dir, ".local/share/jointid")


def test_remains_of_a_killed_write_are_removed_later(tmp_path: Path) -> None:
    left, fresh, own, held = (tmp_path / f".{c * 16}.new" for c in "abxc")
    for file in (left, fresh, own, held):
        file.write_bytes(b"half")
    folder = tmp_path / f".{'d' * 16}.new"
    (folder / "records").mkdir(parents=True)
    for file in (left, own, held, folder):
        aged(file, 60)
    with held.open("rb") as writing:  # by a process that lives
        locked(writing)
        write_file(tmp_path / "table.csv", b"1,2")
        assert sorted(tmp_path.iterdir()) == sorted([fresh, own, held, tmp_path / "table.csv"])
    write_file(tmp_path / "table.csv", b"1,2")
    assert not held.exists()


def test_a_study_moved_by_a_killed_write_is_restored(tmp_path: Path) -> None:
    target, old = tmp_path / "cell", tmp_path / f".cell.{'0' * 16}.old"
    study = load_study(ROOT / "sample_data" / "paper.zip")
    save_study(study, target)
    target.rename(old)
    with pytest.raises(JointIdError, match="exists"):
        save_study(study, target)
    assert study_digest(load_study(target)) == study_digest(study)
    save_study(study, target, overwrite=True)
    assert list(tmp_path.iterdir()) == [target]

"""What the cells of a sweep share: the same bytes as without, forgotten when it should be, never in the way."""

import os
import time
from dataclasses import replace

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

import bench.engine.memo
from bench import Case, PointCloud, Shape, UsageError, Views, generator
from bench.authoring.conformance import toy_views
from bench.engine.memo import Memo, RememberedDataset, RememberedSensor, prune
from bench.geometry.mesh_surface import MeshSurface


@pytest.fixture
def memo(tmp_path):
    return Memo(tmp_path / "cache", "a key")


def counted(value=1.0):
    calls = []

    def make():
        calls.append(1)
        return {"x": np.full(3, value)}

    return make, calls


@pytest.mark.parametrize("limit_gb", [0.1, 2.0])
def test_arrays_are_made_once_and_cached_bit_for_bit(memo, limit_gb):
    memo, (make, calls) = replace(memo, limit_gb=limit_gb), counted(np.pi)
    first, second = memo.arrays("a", make), memo.arrays("a", make)
    assert len(calls) == 1
    assert first["x"].tobytes() == second["x"].tobytes() and first["x"].dtype == second["x"].dtype


@pytest.mark.parametrize(
    "other", [Memo.at, lambda m, *p: Memo(m.folder, "another key"), lambda m, *p: m.at("x").at("y")]
)
def test_another_key_is_another_entry(memo, other):
    memo.arrays("a", counted()[0])
    make, calls = counted()
    other(memo, "part").arrays("a", make)
    assert calls


def test_parts_are_not_run_together(memo):
    assert memo.at("ab", "c").key != memo.at("a", "bc").key


@pytest.mark.parametrize("off", [Memo(None, "a key"), None])
def test_it_can_be_off(off, tmp_path):
    off = off or Memo(tmp_path, "a key", limit_gb=0.0)
    make, calls = counted()
    off.arrays("a", make), off.arrays("a", make)
    assert len(calls) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: b"garbage" * 100,
        lambda content: content[:200] + bytes([content[200] ^ 255]) + content[201:],
    ],
    ids=["empty", "torn", "garbage", "flipped"],
)
def test_a_damaged_entry_is_made_again(memo, damage):
    memo.arrays("a", counted(7.0)[0])
    (path,) = memo.folder.glob("*/*.npz")
    path.write_bytes(damage(path.read_bytes()))
    make, calls = counted(7.0)
    assert (memo.arrays("a", make)["x"] == 7).all() and calls
    assert (memo.arrays("a", make)["x"] == 7).all() and len(calls) == 1


def test_no_object_is_unpickled(memo):
    objects = np.empty(1, dtype=object)
    objects[0] = {"an": "object"}
    memo.arrays("a", lambda: {"x": objects})
    assert list(memo.folder.glob("*/*.npz"))
    make, calls = counted()
    assert (memo.arrays("a", make)["x"] == 1).all() and calls


def test_a_memory_that_cannot_be_written_is_no_error(tmp_path):
    (tmp_path / "cache").write_text("a file where the folder should be")
    assert (Memo(tmp_path / "cache", "k").arrays("a", counted()[0])["x"] == 1).all()


def test_an_entry_that_cannot_be_written_leaves_nothing_behind(memo):
    memo.arrays("a", counted()[0])
    (path,) = memo.folder.glob("*/*.npz")
    path.unlink()
    path.mkdir()
    assert (memo.arrays("a", counted()[0])["x"] == 1).all()
    assert list(memo.folder.glob("*/*")) == [path]


def test_a_reader_takes_what_is_there_and_adds_nothing(memo):
    reader = replace(memo, writes=False)
    reader.at("x").arrays("a", counted()[0])
    assert not list(memo.folder.glob("*/*"))
    memo.at("x").arrays("a", counted()[0])
    reader.at("x").arrays("a", lambda: pytest.fail("was remembered"))


def test_a_nearly_full_disk_is_left_to_the_results(memo, monkeypatch):
    monkeypatch.setattr(bench.engine.memo, "SPARE_BYTES", 1 << 80)
    memo.arrays("a", counted()[0])
    assert not list(memo.folder.glob("*/*"))


def test_what_was_not_used_for_longest_is_forgotten_first(memo):
    for number, name in enumerate("abc"):
        memo.at(name).arrays("x", lambda: {"x": np.zeros(100_000)})
        (path,) = [p for p in memo.folder.glob("*/*") if time.time() - p.stat().st_mtime < 1]
        os.utime(path, (1000 + number, 1000 + number))
    torn = memo.folder / "ab" / "x.tmp"
    torn.parent.mkdir(exist_ok=True)
    torn.write_bytes(bytes(10))
    os.utime(torn, (1, 1))
    memo.at("a").arrays("x", lambda: pytest.fail("was remembered"))  # used now
    prune(memo.folder, limit_gb=2e-3)
    assert not torn.exists()
    memo.at("a").arrays("x", lambda: pytest.fail("was used last"))
    memo.at("c").arrays("x", lambda: pytest.fail("there was room for two"))
    make, calls = counted()
    memo.at("b").arrays("x", make)
    assert calls


def test_where_there_is_room_only_what_a_killed_writer_has_left_is_removed(memo):
    memo.arrays("a", counted()[0])
    (path,) = memo.folder.glob("*/*.npz")
    now = time.time()
    written = {path: 0.0, path.with_name("fresh.tmp"): now - 60, path.with_name("left.tmp"): now - 5400}
    for entry, seconds in written.items():
        entry.touch()
        os.utime(entry, (seconds, seconds))
    prune(memo.folder, limit_gb=1.0)
    assert {entry.name for entry in path.parent.iterdir()} == {path.name, "fresh.tmp"}


def test_the_total_size_is_checked_at_the_first_of_fifty_writes(memo, monkeypatch):
    looks = []
    monkeypatch.setattr(bench.engine.memo, "prune", lambda folder, limit_gb: looks.append((folder, limit_gb)))
    monkeypatch.setattr(bench.engine.memo._Writes, "count", 0)
    for number, expected in (1, 1), (49, 1), (1, 2), (49, 2), (1, 3):
        for _ in range(number):
            memo.at(bench.engine.memo._Writes.count).arrays("a", counted()[0])
        assert looks == [(memo.folder, memo.limit_gb)] * expected


class Dataset:
    name = "balls"

    def __init__(self):
        self.made = 0

    def shapes(self, split):
        for index in range(2):
            yield Shape(f"ball-{split}-{index}", self.mesh, tags=("smooth",), info={"genus": 0}, exactness="polyhedron")

    def mesh(self):
        self.made += 1
        return icosphere(subdivisions=1)


class Files(Dataset):
    def state(self):
        return {}


class Sensor:
    count = 5

    def __init__(self):
        self.used = 0

    def sense(self, shape, rng):
        self.used += 1
        return PointCloud(*shape.surface.sample(self.count, rng))


class Fetched(Files):
    def fetch(self, say):
        """Its files are pinned."""


@pytest.mark.parametrize(("kind", "made"), [(Files, 4), (Fetched, 2)])
def test_the_users_own_files_are_read_again_and_pinned_ones_are_cached(memo, kind, made):
    dataset = kind()
    for _ in range(2):
        assert [len(s.mesh.faces) for s in RememberedDataset(dataset, memo).shapes("test")] == [80, 80]
    assert dataset.made == made


def test_a_cached_dataset_makes_each_mesh_once(memo):
    dataset = Dataset()
    for _ in range(2):
        remembered = RememberedDataset(dataset, memo)
        assert remembered.name == "balls"
        shapes = list(remembered.shapes("test"))
        assert not dataset.made or dataset.made == 2  # nothing is made before it is asked for
        assert [len(s.mesh.faces) for s in shapes] == [80, 80]
        assert shapes[0].tags == ("smooth",) and shapes[0].exactness == "polyhedron" and shapes[0].info == {"genus": 0}
    assert dataset.made == 2
    list(RememberedDataset(dataset, memo).shapes("train"))[0].mesh  # noqa: B018
    assert dataset.made == 3


class Points(Dataset):
    """Of its shapes only the points are known."""

    def mesh(self):
        self.made += 1
        return PointCloud(np.eye(4, 3), np.eye(4, 3), scalars={"heat": np.arange(4.0)})


class Doubled(Dataset):
    """Two triangles that meet along an edge and share no vertex."""

    def mesh(self):
        self.made += 1
        corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
        return Trimesh(corners, [[0, 1, 2], [3, 5, 4]], process=False)


@pytest.mark.parametrize("kind", [Points, Doubled])
def test_a_cached_shape_is_a_cloud_or_a_mesh_as_it_was_made(memo, kind):
    dataset, made = kind(), kind().mesh()
    for _ in range(2):
        shape = next(RememberedDataset(dataset, memo).shapes("test"))
        if kind is Points:
            assert shape.cloud.arrays().keys() == made.arrays().keys()
            assert all(np.array_equal(shape.cloud.arrays()[name], array) for name, array in made.arrays().items())
        else:
            assert shape.cloud is None
            assert np.array_equal(shape.mesh.vertices, made.vertices) and np.array_equal(shape.mesh.faces, made.faces)
    assert dataset.made == 1


class Odd(Dataset):
    def shapes(self, split):
        yield Shape("a\udcff\0b", self.mesh)


def test_ids_are_what_a_file_can_hold(memo):
    """Seeds and rows are made of them."""
    assert [shape.id for shape in RememberedDataset(Odd(), memo).shapes("test")] == [r"a\udcff\x00b"]


def test_the_users_files_are_not_copied(memo):
    dataset = Files()
    for _ in range(2):
        next(RememberedDataset(dataset, memo).shapes("test")).mesh  # noqa: B018
    assert dataset.made == 2


def test_a_cached_sensor_senses_each_shape_once_for_each_seed(memo):
    shape, plain = next(Dataset().shapes("test")), Sensor()
    sensor = RememberedSensor(plain, memo)
    clouds = [sensor.sense(shape, generator(seed)) for seed in (0, 0, 1)]
    assert plain.used == 2 and sensor.count == 5
    assert (clouds[0].points == Sensor().sense(shape, generator(0)).points).all()
    assert (clouds[0].points == clouds[1].points).all() and (clouds[0].normals == clouds[1].normals).all()
    assert (clouds[0].points != clouds[2].points).any()
    first, second = generator(0).spawn(2)
    assert (sensor.sense(shape, first).points != sensor.sense(shape, second).points).any()


class Spawning(Sensor):
    """Draws from a child of its generator, which what was spawned before decides, and the state does not."""

    def sense(self, shape, rng):
        return super().sense(shape, rng.spawn(1)[0])


def test_generators_of_one_state_that_spawn_different_children_share_no_cloud(memo):
    shape, plain = next(Dataset().shapes("test")), Spawning()
    fresh, used = generator(0), generator(0)
    used.spawn(1)
    assert str(fresh.bit_generator.state) == str(used.bit_generator.state)
    sensor = RememberedSensor(plain, memo)
    first, second = sensor.sense(shape, fresh), sensor.sense(shape, used)
    assert plain.used == 2 and (first.points != second.points).all()
    expected = generator(0)
    for cloud in first, second:
        assert (cloud.points == Spawning().sense(shape, expected).points).all()


class Rig:
    def __init__(self, given=None):
        self.given, self.used = given or toy_views(), 0

    def sense(self, shape, rng):
        self.used += 1
        return self.given


def test_a_cached_rig_gives_its_very_views_again(memo):
    plain = Rig()
    rig = RememberedSensor(plain, memo, Views)
    first, second = (rig.sense(next(Dataset().shapes("test")), generator(0)) for _ in range(2))
    assert plain.used == 1
    for given in (first, second):
        assert isinstance(given, Views)
        assert given.arrays().keys() == plain.given.arrays().keys()
        for name, array in plain.given.arrays().items():
            assert given.arrays()[name].dtype == array.dtype and np.array_equal(given.arrays()[name], array)


def test_what_a_sensor_gives_is_what_it_says(memo):
    with pytest.raises(UsageError, match="sensor Rig: expected a PointCloud from sense.., got Views"):
        RememberedSensor(Rig(), memo).sense(next(Dataset().shapes("test")), generator(0))
    assert not list(memo.folder.glob("*/*"))


def test_a_cloud_is_made_of_its_arrays_again():
    for cloud in (PointCloud(np.eye(3)), PointCloud(np.eye(3), np.eye(3), np.ones((3, 3)))):
        again = PointCloud.of(cloud.arrays())
        assert again.arrays().keys() == cloud.arrays().keys()
        assert all(np.array_equal(again.arrays()[name], array) for name, array in cloud.arrays().items())


def test_a_sensor_s_clouds_are_of_the_shape_and_not_of_its_id(memo):
    """The shapes of two splits, or of a pair, may share an id; tasks that give the same shape share the cloud."""
    plain, mesh = Sensor(), icosphere(subdivisions=1)
    sensor = RememberedSensor(plain, memo)
    larger = Shape("ball", mesh.copy().apply_scale(2.0))
    one, other = sensor.sense(Shape("ball", mesh), generator(0)), sensor.sense(larger, generator(0))
    assert np.linalg.norm(other.points, axis=1).min() > 1 > np.linalg.norm(one.points, axis=1).max() - 1e-9
    again = sensor.sense(Shape("ball", icosphere(subdivisions=1), tags=("smooth",)), generator(0))
    assert (again.points == one.points).all() and plain.used == 2
    exact = Shape("ball", mesh, surface=Stretched(mesh))  # the same mesh, and not the same surface
    assert (sensor.sense(exact, generator(0)).points != one.points).all()


class Stretched(MeshSurface):
    def sample(self, count, rng):
        points, normals = super().sample(count, rng)
        return 3 * points, normals


def test_a_case_compares_the_same_with_and_without(memo):
    mesh = icosphere(subdivisions=2)
    output = PointCloud(mesh.vertices * 1.1)
    plain = Case("ball", {}, Shape("ball", mesh), seed=3)
    for _ in range(2):  # written, then read
        case = Case("ball", {}, Shape("ball", mesh), seed=3, _memo=memo)
        a, b = plain.compare(output), case.compare(output)
        assert (a.to_output.distance == b.to_output.distance).all()
        assert (plain.perfect(output).points == case.perfect(output).points).all()

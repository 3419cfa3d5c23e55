"""Work on other processes: the same bits as here, also when one of them dies over it."""

import multiprocessing
import os
import pickle
import re
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import executors
from cyclorama.placement import painting, search
from cyclorama.placement.backdrops import Backdrops
from peers import need
from reference.placement import FewImages


@pytest.fixture(scope="module")
def cluster():
    """A Dask client of two worker processes, which are started again when they die."""
    need("distributed")
    from dask import config
    from distributed import Client, LocalCluster

    with config.set({"distributed.comm.timeouts.connect": "60s"}):
        local = LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0, silence_logs=50
        )
        with local, Client(local) as client:
            yield client


@pytest.fixture(scope="module")
def scene():
    return cyc.scenes.gear(4000)


BAKE = {"views": 18, "resolution": (64, 60), "probes": 8, "progress": False}


@pytest.fixture(scope="module")
def alone(scene):
    return cyc.bake(scene, **BAKE)


def same(a, b):
    assert a.bitfields == b.bitfields
    assert a.cells == b.cells
    np.testing.assert_array_equal(a.probes, b.probes)
    np.testing.assert_array_equal(a.found, b.found)


def test_a_scene_goes_to_another_process_whole(scene):
    parts = [cyc.parts.Part("a", "a", 0, 10), cyc.parts.Part("b", "b", 10, len(scene))]
    mask = np.arange(len(scene)) % 7 == 0
    there = pickle.loads(pickle.dumps(cyc.Scene(scene.vertices, scene.faces, transparent=mask, parts=parts)))
    np.testing.assert_array_equal(there.transparent, mask)
    assert there.parts == tuple(parts)
    camera = cyc.Camera.look_at((1, 2, 4), (0, 0, 0), width=40, height=30)
    np.testing.assert_array_equal(
        there.render(camera).depth, cyc.Scene(scene.vertices, scene.faces, transparent=mask).render(camera).depth
    )


def test_no_more_tasks_wait_than_memory_is_for():
    begun, most = 0, 0

    def count():
        nonlocal begun
        for index in range(100):
            begun += 1
            yield (index,)

    with ThreadPoolExecutor(2) as pool:
        found = executors.Team(pool, 10).run(divmod, ((k + 1,) for (k,) in count()))
        for taken, (place, result) in enumerate(found):
            most = max(most, begun - taken)
            assert result == divmod(10, place + 1)
    assert most <= executors.AHEAD


def waited(gate, place):
    if place == 0:
        assert gate.wait(60)
    return place


def test_a_slow_task_holds_back_none_of_the_others():
    gate, came = threading.Event(), []
    with ThreadPoolExecutor(2) as pool:
        for place, result in executors.Team(pool, gate).run(waited, ((k,) for k in range(50))):
            assert place == result
            came.append(place)
            if len(came) == 49:
                gate.set()
    assert sorted(came) == list(range(50))
    assert came[-1] == 0


class Uneven(ThreadPoolExecutor):
    """Threads that take their time over every fifth task, so that later ones end before it."""

    submitted = 0

    def submit(self, function, /, *arguments):
        self.submitted += 1
        return super().submit(late, 0.2 if self.submitted % 5 == 1 else 0.0, function, *arguments)


def late(seconds, function, *arguments):
    time.sleep(seconds)
    return function(*arguments)


def test_bakes_and_boxes_have_the_same_bits_in_whatever_order_results_come(scene, alone, monkeypatch):
    came = []
    run = executors.Team.run

    def noted(self, function, tasks):
        places = []
        came.append(places)
        for place, result in run(self, function, tasks):
            places.append(place)
            yield place, result

    monkeypatch.setattr(executors.Team, "run", noted)
    boxes = cyc.scenes.pipes(2000)
    monkeypatch.setitem(search._SIGHT, "resolution", 16)
    monkeypatch.setitem(search._SIGHT, "max_eyes", 2)
    options = {"budget": 1500, "visibility": 2, "leaf_depth": 3, "progress": False}
    here = cyc.place_images(boxes, **options)
    with Uneven(3) as pool:
        same(cyc.bake(scene, **BAKE, executor=pool), alone)
        assert any(places != sorted(places) for places in came)
        there = cyc.place_images(boxes, **options, executor=pool)
    np.testing.assert_array_equal(there.sight.visible, here.sight.visible)


def held(value, _):
    """Bytes that this process has held at most."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", status)[1])


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux what a process holds")
def test_a_worker_holds_what_the_tasks_share_once_and_drops_it_for_the_next():
    scene, another = np.ones(2_500_000), np.zeros(2_500_000)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        rest = dict(executors.Team(pool, 0).run(held, [(0,)]))[0]
        peaks = [dict(executors.Team(pool, value).run(held, zip(range(12)))) for value in (scene, another)]
    # The value, its pickle, which is kept to be sent on, and that of a task on its way in; for a while beside these an
    # older value and its pickle.
    assert rest + 2 * scene.nbytes < peaks[0][11] < rest + 4 * scene.nbytes
    assert peaks[1][11] < rest + 5.5 * scene.nbytes


def test_a_task_that_fails_ends_the_work_and_says_why():
    with ThreadPoolExecutor(1) as pool, pytest.raises(ZeroDivisionError):
        list(executors.Team(pool, 1).run(divmod, [(k,) for k in (1, 0, 1)]))


def test_a_bake_on_threads_has_the_same_bits(scene, alone):
    done = []
    with ThreadPoolExecutor(2) as pool:
        same(cyc.bake(scene, **BAKE | {"progress": done.append}, executor=pool), alone)
    assert done == sorted(done)
    assert done[-1] == 18 + 32 * 8


def test_a_bake_within_an_error_on_threads_has_the_same_bits(scene):
    options = {"max_missed": 0.02, "resolution": (48, 40), "probes": 4, "progress": False}
    with ThreadPoolExecutor(2) as pool:
        found = cyc.bake(scene, **options, executor=pool)
    expected = cyc.bake(scene, **options)
    same(found, expected)
    assert found.statement == expected.statement


class Killing:
    """Kills a worker of a cluster, once, when so much is done."""

    def __init__(self, cluster, after):
        self.cluster, self.after, self.killed = cluster, after, None
        self.pids = list(cluster.run(os.getpid).values())

    def __call__(self, done):
        if done >= self.after and self.killed is None:
            self.killed = self.pids[0]
            os.kill(self.killed, signal.SIGKILL)

    def check(self):
        assert self.killed is not None
        assert self.killed not in self.cluster.run(os.getpid).values()


def test_a_bake_on_a_cluster_has_the_same_bits_though_a_worker_is_killed(cluster, scene, alone):
    kill = Killing(cluster, 60)
    same(cyc.bake(scene, **BAKE | {"progress": kill}, executor=cluster), alone)
    kill.check()


def test_the_cluster_s_own_executor_will_do(cluster, scene, alone):
    same(cyc.bake(scene, **BAKE, executor=cluster.get_executor()), alone)


def test_backdrops_are_painted_on_a_cluster_with_the_same_bits_though_a_worker_is_killed(cluster, tmp_path):
    scene = cyc.scenes.pipes(1000)
    plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
    used = painting.uses(plan, 1500)
    folders, kill = [], Killing(cluster, 1)
    for name, options in (("here", {"threads": 1}), ("there", {"executor": cluster})):
        made = Backdrops(plan, scene, tmp_path / name, size=(32, 24), construction=1, spread=1.5, max_error=80.0)
        made._uses = used
        done = []

        def report(count, done=done, name=name):
            done.append(count)
            if name == "there":
                kill(count)

        assert made.paint(**options, progress=report) == 2
        assert done[-1] == 2
        folders.append(made)
    kill.check()
    here, there = folders
    keys = [key for index in (0, 1) for key in here.leaves(index)]
    assert keys == [key for index in (0, 1) for key in there.leaves(index)]
    assert len(keys) > 2, "some are divided"
    for key in keys:
        a, b = here.store.get(key), there.store.get(key)
        for name in ("offsets", "color", "disparity", "place"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert here.notes.get(key) == there.notes.get(key)
    for made in folders:
        made.close()


def test_what_boxes_see_has_the_same_bits_though_a_worker_is_killed(cluster, monkeypatch):
    scene = cyc.scenes.pipes(3000)
    options = {"budget": 2200, "visibility": 2, "leaf_depth": 4, "progress": False}
    kill, run = Killing(cluster, 2), executors.Team.run

    def noted(self, function, tasks):
        for done, result in enumerate(run(self, function, tasks)):
            kill(done)
            yield result

    monkeypatch.setattr(executors.Team, "run", noted)
    there, here = (cyc.place_images(scene, **options, executor=executor) for executor in (cluster, None))
    kill.check()
    np.testing.assert_array_equal(there.sight.visible, here.sight.visible)
    np.testing.assert_array_equal(there.parameters, here.parameters)


def test_plans_go_to_other_processes_and_what_boxes_see_comes_from_an_executor(monkeypatch):
    monkeypatch.setitem(search._SIGHT, "resolution", 32)
    monkeypatch.setitem(search._SIGHT, "max_eyes", 9)
    scene = cyc.scenes.pipes(3000)
    options = {"budget": 2200, "visibility": 1, "leaf_depth": 4, "progress": False}
    plan = cyc.place_images(scene, **options)
    with ThreadPoolExecutor(2) as pool:
        there = cyc.place_images(scene, **options, executor=pool)
    np.testing.assert_array_equal(there.parameters, plan.parameters)
    np.testing.assert_array_equal(there.sight.visible, plan.sight.visible)
    again = pickle.loads(pickle.dumps(plan))
    frames = [each.frame([0, 0, -0.9], [0, 0, 1]) for each in (plan, again)]
    np.testing.assert_array_equal(frames[0].faces, frames[1].faces)
    assert (frames[0].image is None) == (frames[1].image is None)


def test_what_is_no_executor_is_refused(scene):
    with pytest.raises(ValueError, match=r"executor must have submit\(\)"):
        cyc.bake(scene, **BAKE, executor=4)

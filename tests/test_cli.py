"""The command line: what it prints, what it writes, and what it refuses with one line and status 2."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import cli, validation

#: Quick bakes: two dozen small views.
QUICK = ["--views", "6", "--resolution", "48x48", "--join", "samples", "-q"]


def write_ply(path, vertices, faces):
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, vertex)) for vertex in np.asarray(vertices).tolist()]
    lines += [" ".join(map(str, [len(face), *face])) for face in np.asarray(faces).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    pytest.importorskip("trimesh", reason="reads meshes")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def mesh(tmp_path):
    sphere = cyc.scenes.sphere(faces=320)
    return write_ply(tmp_path / "ball.ply", sphere.vertices, sphere.faces)


@pytest.fixture
def baked(mesh, tmp_path):
    assert cli.main(["bake", str(mesh), *QUICK]) == 0
    return tmp_path / "ball.npz"


def run(*words):
    return cli.main([str(word) for word in words])


def refused(capsys, *words, match=()):
    """Runs a command that must be refused, and checks that it says so in one line."""
    before = sorted(os.listdir())
    capsys.readouterr()
    status = run(*words)
    said = capsys.readouterr()
    assert status == 2, said
    assert said.err.startswith("cyclorama: error: ") and said.err.count("\n") == 1 and said.err.endswith("\n"), said.err
    assert "Traceback" not in said.err
    for part in [match] if isinstance(match, str) else match:
        assert part in said.err, said.err
    assert sorted(os.listdir()) == before, "something was left behind"
    return said.err


# What works


def test_bake_then_ask(mesh, baked, capsys):
    vis = cyc.Visibility.load(baked)
    eye = np.array([3.0, -1.0, 2.0])
    capsys.readouterr()
    assert run("info", "--faces", *eye, baked) == 0
    listed = np.array(capsys.readouterr().out.split(), dtype=np.uint32)
    np.testing.assert_array_equal(listed, vis.visible_faces(eye))
    assert run("info", "--faces", "3,-1,2", baked, "--count") == 0
    assert int(capsys.readouterr().out) == len(listed)


def test_an_eye_may_begin_with_a_minus(baked, capsys):
    capsys.readouterr()
    assert run("info", baked, "--count", "--faces", "-3,0,0") == 0
    assert run("info", baked, "--count", "--faces", "-3", "-1e-3", "0") == 0


def test_info_of_a_mesh_counts_what_is_broken_in_it(tmp_path, capsys):
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    path = write_ply(tmp_path / "broken.ply", vertices, [[0, 1, 2], [2, 0, 1], [0, 1, 1], [0, 1, 3]])
    assert run("info", path) == 0
    said = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert (said["faces"], said["degenerate"], said["duplicate"], said["watertight"]) == ("4", "1", "1", "no")


def test_info_of_a_visibility_file_says_how_it_was_made(baked, capsys):
    capsys.readouterr()
    assert run("info", baked) == 0
    said = capsys.readouterr().out
    assert "resolution       48 48" in said and "samples" in said and f"{baked.stat().st_size:,} bytes" in said


def test_a_bake_on_processes_is_the_same_file(mesh, baked, tmp_path):
    assert run("bake", mesh, *QUICK, "--workers", 2, "-o", tmp_path / "there.npz") == 0
    there, here = cyc.Visibility.load(tmp_path / "there.npz"), cyc.Visibility.load(baked)
    assert there.bitfields == here.bitfields and there.cells == here.cells


def test_a_bake_has_one_kind_of_workers(mesh, capsys):
    assert run("bake", mesh, "--workers", 2, "--dask", "localhost:1") == 2
    assert "not allowed with argument" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["seen.npy", "seen.glb"])
def test_what_an_eye_may_see_is_exported(mesh, baked, tmp_path, capsys, name):
    assert run("export", baked, tmp_path / name, "--mesh", mesh, "--eye", "0,0,3") == 0
    expected = cyc.Visibility.load(baked).visible_faces([0, 0, 3])
    assert f"{len(expected):,} of " in capsys.readouterr().out
    if name.endswith(".npy"):
        np.testing.assert_array_equal(np.flatnonzero(np.load(tmp_path / name)), expected)
        return
    sizes = {part.name: len(part) for part in cyc.load(tmp_path / name).parts}
    assert sum(size for part, size in sizes.items() if "never" not in part) == len(expected)


def test_other_endings_are_refused(mesh, baked, tmp_path, capsys):
    assert run("export", baked, tmp_path / "seen.obj", "--eye", "0,0,3") == 2
    assert "does not end in .glb or .npy" in capsys.readouterr().err
    assert run("tradeoff", mesh, "--csv", "rows.xls") == 2


def test_patches_are_baked_where_asked(mesh, tmp_path):
    assert run("bake", mesh, *QUICK, "--patches", 10, "-o", tmp_path / "ten.npz") == 0
    assert cyc.Visibility.load(tmp_path / "ten.npz").patches == 10


def test_tradeoff_prints_its_rows_and_writes_chart_and_figures(mesh, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="draws the chart")
    status = run(
        "tradeoff", mesh, "--views", 6, 18, "--patches", "none", 20, "--resolution", "48x48", "--join", "samples",
        "--eval-views", 4, "--out", "chart.png", "--csv", "rows.csv", "--max-missed", 1, "-q",
    )  # fmt: skip
    assert status == 0
    said = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("|") for line in said) == (2 + 4) + (2 + 2), (
        "the rows, and the cheapest in bytes and in faces"
    )
    assert (tmp_path / "chart.png").stat().st_size > 10_000
    rows = (tmp_path / "rows.csv").read_text().splitlines()
    assert len(rows) == 5 and rows[0].startswith("views,resolution,fill,join,patches,time,bytes")


def test_validate_ends_with_0_where_all_agree_and_1_where_one_does_not(mesh, capsys, monkeypatch):
    assert run("validate", mesh, "--views", 1, "--resolution", "64x48", "-q") == 0
    assert "agrees" in capsys.readouterr().out
    honest = validation._engines
    monkeypatch.setattr(validation, "_engines", lambda *a: honest(*a) | {"ok": False})
    assert run("validate", mesh, "--views", 1, "--resolution", "64x48", "-q") == 1
    assert "DISAGREES" in capsys.readouterr().out


def test_demo_draws_and_prints(mesh, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="draws the pictures")
    assert run("demo", mesh, "--out", tmp_path / "pictures", "--views", 6, "-q") == 0
    said = capsys.readouterr().out
    for word in ("culled", "missed", "bytes", "bake"):
        assert word in said
    assert sorted(os.listdir(tmp_path / "pictures")) == ["demo.png", "tradeoff.png"]


@pytest.mark.parametrize("command", ["demo", "bake", "info", "tradeoff", "validate"])
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as end:
        run(command, "--help")
    assert end.value.code == 0
    assert "usage: cyclorama " + command in capsys.readouterr().out


def test_python_m_is_the_same_command():
    said = subprocess.run([sys.executable, "-m", "cyclorama", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == f"cyclorama {cyc.__version__}"


# What is refused


def test_a_command_that_is_none(capsys):
    refused(capsys, match="COMMAND")
    refused(capsys, "cull", match="cull")


def test_a_mesh_that_is_not_there_or_none(capsys, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.ply").write_text("not a mesh")
    (tmp_path / "empty.obj").write_text("")
    for command in ("bake", "info", "tradeoff", "validate", "demo"):
        refused(capsys, command, "nothing.ply", match="nothing.ply")
        refused(capsys, command, "folder", match="folder")
        refused(capsys, command, "text.ply", match="text.ply")
        refused(capsys, command, "empty.obj", match="empty.obj")


@pytest.mark.parametrize(
    ("vertices", "faces", "says"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, float("nan"), 0]], [[0, 1, 2]], "nan"),
        ([[0, 0, 0], [1, 0, 0], [0, float("inf"), 0]], [[0, 1, 2]], "inf"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 7]], "7"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "area"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [], ""),
    ],
    ids=["nan", "infinite", "index", "degenerate", "empty"],
)
def test_a_mesh_that_is_broken(capsys, tmp_path, vertices, faces, says):
    path = write_ply(tmp_path / "broken.ply", vertices, faces)
    for command in ("bake", "info", "validate"):
        refused(capsys, command, path, match=says)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--views", "-6"], "-6"),
        (["--views", "3"], "3"),
        (["--views", "six"], "six"),
        (["--patches", "0"], "0"),
        (["--patches", "-2"], "-2"),
        (["--resolution", "0x480"], "0x480"),
        (["--resolution", "510"], "510"),
        (["--fov-y", "0"], "fov_y"),
        (["--fov-y", "180"], "fov_y"),
        (["--fov-y", "nan"], "fov_y"),
        (["--probes", "-1"], "probes"),
        (["--distances", "0"], "0"),
        (["--distances", "1,x"], "1,x"),
        (["--max-missed", "-1"], "max_missed"),
        (["--fill", "foam"], "foam"),
        (["--join", "glue"], "glue"),
        (["--threads", "0"], "0"),
        (["--seed", "-1"], "-1"),
        (["--nonsense"], "--nonsense"),
        (["-o", "no/such/folder/x.npz"], "x.npz"),
        (["-o", "."], "folder"),
    ],
)
def test_bake_refuses(capsys, mesh, words, says):
    refused(capsys, "bake", mesh, "-q", *words, match=says)


def test_a_bake_does_not_overwrite_its_mesh(capsys, mesh):
    before = mesh.read_bytes()
    refused(capsys, "bake", mesh, "-o", mesh.name, match="the mesh itself")
    assert mesh.read_bytes() == before


def test_a_folder_that_cannot_be_written_is_found_before_the_work(capsys, mesh, tmp_path, monkeypatch):
    locked = tmp_path / "locked"
    locked.mkdir()
    monkeypatch.setattr(cli.baking, "bake", lambda *a, **k: pytest.fail("the work began"))
    monkeypatch.setattr(cli, "tradeoff", lambda *a, **k: pytest.fail("the work began"))

    def no(*a, **k):
        raise PermissionError(13, "Permission denied", str(locked))

    # Root may write anywhere, so the refusal itself is staged.
    monkeypatch.setattr("cyclorama.files.tempfile.TemporaryFile", no)
    refused(capsys, "bake", mesh, "-o", locked / "ball.npz", match=["locked", "cannot write"])
    refused(capsys, "tradeoff", mesh, "--out", locked / "chart.png", match=["locked", "cannot write"])


def test_a_visibility_file_that_is_not_whole_or_none(capsys, baked, tmp_path):
    whole = baked.read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "empty.npz").write_bytes(b"")
    np.savez(tmp_path / "foreign.npz", a=np.arange(3))
    for name in ("half.npz", "text.npz", "empty.npz", "foreign.npz"):
        refused(capsys, "info", tmp_path / name, match=name)
        refused(capsys, "info", tmp_path / name, "--faces", "1,2,3", match=name)


@pytest.mark.parametrize("eye", ["1,2", "a,b,c", "nan,0,0", "1,2,inf", ""])
def test_an_eye_that_is_no_place(capsys, baked, eye):
    refused(capsys, "info", baked, "--faces", eye, match="faces")


def test_a_question_to_the_wrong_kind_of_file(capsys, mesh, baked):
    refused(capsys, "info", mesh, "--faces", "1,2,3", match="bake")
    refused(capsys, "info", baked, "--count", match="--faces")


def test_a_chart_of_an_unknown_format_is_refused_before_any_work(capsys, mesh, monkeypatch):
    monkeypatch.setattr(cli, "tradeoff", lambda *a, **k: pytest.fail("the work began"))
    refused(capsys, "tradeoff", mesh, "--out", "chart.xyz", match=["chart.xyz", ".png"])


def test_an_unreachable_error_is_said(capsys, mesh):
    quick = ["--views", 6, "--patches", "none", "--resolution", "48x48", "--eval-views", 2, "--join", "samples", "-q"]
    refused(capsys, "tradeoff", mesh, *quick, "--max-missed", "-1", match="the least is")


def test_ctrl_c_ends_with_130_and_leaves_no_file(tmp_path):
    gear = cyc.scenes.gear(faces=40_000)
    write_ply(tmp_path / "gear.ply", gear.vertices, gear.faces)
    # The signal is sent once the work has begun: some packages swallow it while they are imported.
    script = """if True:
        import sys
        from cyclorama import cli
        bake = cli.baking.bake
        cli.baking.bake = lambda *a, **k: print("begun", flush=True) or bake(*a, **k)
        sys.exit(cli.main(sys.argv[1:]))
    """
    work = subprocess.Popen(
        [sys.executable, "-c", script, "bake", "gear.ply", "--views", "4098"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert work.stdout.readline() == "begun\n"
        time.sleep(0.5)
        work.send_signal(signal.SIGINT)
        err = work.communicate(timeout=30)[1]
    finally:
        work.kill()
    assert work.returncode == 130, err
    assert err.strip().splitlines()[-1] == "cyclorama: interrupted"
    assert os.listdir(tmp_path) == ["gear.ply"]


def test_a_warning_is_one_line(tmp_path, capfd):
    mesh = tmp_path / "box.off"
    mesh.write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 1\n3 0 1 2\n3 0 2 3\n")
    arguments = ["bake", str(mesh), "--views", "6", "--patches", "9", "-o", str(tmp_path / "box.npz")]
    assert cli.main(arguments) == 0
    said = capfd.readouterr().err
    assert [line for line in said.splitlines() if "warning" in line.lower()] == [
        line for line in said.splitlines() if line.startswith("cyclorama: warning: ")
    ]
    assert "cyclorama: warning: " in said
    assert ".py" not in said


def test_place_writes_a_plan_and_the_chart_of_a_path(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="draws the chart")
    pipes = cyc.scenes.pipes(20_000)
    mesh = write_ply(tmp_path / "pipes.ply", pipes.vertices, pipes.faces)
    assert run("place", mesh, "--budget", "65%", "--chart", "path.png", "--frames", 20, "-q") == 0
    said = capsys.readouterr().out
    assert "13,000 of 20,000 faces" in said and "frames of the path" in said
    plan = cyc.placement.Plan.load("pipes.plan.npz", cyc.load(mesh))
    assert plan.budget == 13_000 and len(plan.images) > 0
    assert (tmp_path / "path.png").stat().st_size > 1000
    refused(capsys, "place", mesh, "--budget", "1%", "-q", match="is too small")
    refused(capsys, "place", mesh, "--budget", "0%", match="not a share above 0%")
    refused(capsys, "place", mesh, "--out", mesh, match="is the mesh itself")

# SPDX-License-Identifier: Apache-2.0
"""Meshes as solids: nothing of a mesh stands out, how far the solids do, where files are found and kept."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from cable_ros.robot_overlaps import RobotOverlaps
from cable_ros.scene import Capsule, SceneError, load_scene
from cable_ros.scene.robot_obstacles import fit_meshes
from cable_ros.scene.solids import distances

trimesh = pytest.importorskip("trimesh", reason="collision meshes need the extra 'mesh'")

from cable_ros.scene import mesh_files, mesh_fit  # noqa: E402

ORIGIN = np.array([0.3, -0.2, 0.1])


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def quick(monkeypatch):
    """Fits that take a tenth of the time."""
    monkeypatch.setattr(mesh_fit, "AROUND", 1000)
    monkeypatch.setattr(mesh_fit, "SAMPLES", 20_000)


def elbow():
    """Two bars at a right angle."""
    one = trimesh.creation.box(extents=[0.1, 0.1, 0.5])
    other = trimesh.creation.box(extents=[0.4, 0.1, 0.1])
    other.apply_translation([0.15, 0.0, 0.3])
    return trimesh.util.concatenate([one, other])


def urdf(filename, scale="1 1 1", origin="0 0 0"):
    mesh = f"<mesh filename='{filename}' scale='{scale}'/>"
    collision = f"<collision><origin xyz='{origin}'/><geometry>{mesh}</geometry></collision>"
    return f"<robot name='r'><link name='base'>{collision}</link></robot>"


def scene(path, text, obstacles=({"robot": {}},)):
    """Of a URDF file in the folder `path`; the cable is far away."""
    (path / "arm.urdf").write_text(text)
    clamp = {"position": [0, 5, 0], "orientation": [0, 0, 0, 1]}
    cable = {
        "name": "hose", "length": 1.0, "stiffness": [1, 1, 1], "linear_density": 0.1,
        "start": clamp, "end": {**clamp, "position": [0.5, 5, 0]},
    }  # fmt: skip
    values = {"robot": {"urdf": str(path / "arm.urdf")}, "gravity": [0, 0, -9.8], "cables": [cable]}
    return load_scene(values | ({"obstacles": list(obstacles)} if obstacles else {}))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("make", [elbow, lambda: trimesh.creation.torus(0.2, 0.05, 16, 8)])
def test_nothing_of_a_mesh_stands_out(make):
    """By points all over its triangles that the fit has not seen."""
    mesh = make()
    found = mesh_fit.fit(mesh)
    points, _ = trimesh.sample.sample_surface(mesh, 20_000, seed=7)
    least = np.min([distances(solid, points) for solid in found.solids], axis=0)
    assert least.max() <= 0.0
    assert found.bare == 0.0
    assert len(found.solids) <= mesh_fit.MOST_SOLIDS


@pytest.mark.usefixtures("quick")
def test_an_elbow_of_two_boxes_is_two_boxes():
    found = mesh_fit.fit(elbow())
    assert len(found.solids) == 2
    assert found.outside < 5e-3  # the distance between the points that stand for the mesh


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("count", [8, 16, 32])
def test_a_meshed_capsule_is_that_capsule(count):
    """Its corners are on the surface; it stands out by what the polyhedron lacks, R (1 - cos(pi / n))."""
    found = mesh_fit.fit(trimesh.creation.capsule(height=0.5, radius=0.1, count=[count, count]))
    (solid,) = found.solids
    assert isinstance(solid, Capsule)
    assert solid.radius == pytest.approx(0.1, rel=1e-6)
    np.testing.assert_allclose([solid.start, solid.end], [[0, 0, -0.25], [0, 0, 0.25]], atol=1e-6)
    lacking = 0.1 * (1.0 - np.cos(np.pi / count))
    assert 0.9 * lacking < found.outside < 2.0 * lacking + 4e-3  # the distance of the mesh's samples


def test_winding_is_one_inside_and_zero_outside():
    mesh = elbow()
    inside = np.array([[0.0, 0.0, -0.2], [0.3, 0.0, 0.3]])
    outside = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.9]])
    assert mesh_fit.winding(np.array(mesh.triangles), inside) == pytest.approx(1.0, abs=1e-9)
    assert mesh_fit.winding(np.array(mesh.triangles), outside) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("kind", ["stl", "obj"])
def test_a_scene_takes_a_mesh_where_the_urdf_has_it(kind, tmp_path):
    """Scaled from millimetres, and moved by the collision's origin; every corner is inside."""
    mesh = elbow()
    mesh.apply_scale(1000.0)
    mesh.export(tmp_path / f"elbow.{kind}")
    found = scene(tmp_path, urdf(f"elbow.{kind}", "0.001 0.001 0.001", "0.3 -0.2 0.1"))
    corners = elbow().vertices + ORIGIN
    least = np.min([distances(one.shape, corners) for one in found.obstacles], axis=0)
    assert -0.02 < least.min() <= least.max() <= 1e-8  # an STL has numbers of four bytes
    assert "<mesh" not in found.robot.urdf
    (fit,) = found.robot.fits
    assert (fit.link, fit.solids) == ("base", len(found.obstacles))
    assert found.notes[0].startswith(f"The mesh of 'base', as {fit.solids} solid")


@pytest.mark.usefixtures("quick")
def test_who_has_the_scene_s_urdf_needs_no_mesh(tmp_path):
    elbow().export(tmp_path / "elbow.stl")
    first = scene(tmp_path, urdf("elbow.stl"))
    (tmp_path / "elbow.stl").unlink()
    again = scene(tmp_path, first.robot.urdf)
    for one, other in zip(first.obstacles, again.obstacles, strict=True):
        for name, value in vars(one.shape).items():
            np.testing.assert_array_equal(value, vars(other.shape)[name])


@pytest.mark.usefixtures("quick")
def test_packages(tmp_path, monkeypatch):
    """By the ament index, and in a folder of the package's name above the URDF."""
    share = tmp_path / "prefix" / "share"
    (share / "ament_index" / "resource_index" / "packages").mkdir(parents=True)
    (share / "ament_index" / "resource_index" / "packages" / "parts").touch()
    (share / "parts").mkdir()
    trimesh.creation.box(extents=[0.1, 0.2, 0.3]).export(share / "parts" / "box.stl")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    assert scene(tmp_path, urdf("package://parts/box.stl")).obstacles
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    (share / "parts" / "urdf").mkdir()
    assert scene(share / "parts" / "urdf", urdf("package://parts/box.stl")).obstacles
    with pytest.raises(SceneError, match=r"its mesh package://parts/box\.stl: there is no package 'parts'"):
        scene(tmp_path, urdf("package://parts/box.stl"))


@pytest.mark.usefixtures("quick")
def test_solids_are_kept_and_damaged_ones_made_again(tmp_path, monkeypatch):
    elbow().export(tmp_path / "elbow.stl")
    calls = []
    found = mesh_fit.fit(elbow())  # once: what is kept does not depend on what it took
    monkeypatch.setattr(mesh_fit, "fit", lambda mesh: calls.append(1) or found)
    names = [[one.name for one in scene(tmp_path, urdf("elbow.stl")).obstacles] for _ in range(2)]
    assert (len(calls), names[0]) == (1, names[1])
    (kept,) = mesh_files.cache_folder().iterdir()
    whole = kept.read_text()
    for damaged in ("", whole[: len(whole) // 2], "[]", whole.replace("Box", "Cone"), '{"solids": []}'):
        kept.write_text(damaged)
        scene(tmp_path, urdf("elbow.stl"))
        assert kept.read_text() == whole
    assert len(calls) == 6
    scene(tmp_path, urdf("elbow.stl", "2 2 2"))
    assert len(calls) == 7


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("none.stl", None, "its mesh .*none.stl cannot be read \\(No such file"),
        ("bad.stl", b"solid x\nfacet", "its mesh .*bad.stl (cannot be read|has no triangles)"),
        ("bad.ply", b"ply", "is none of stl, dae, obj"),
    ],
)
def test_mistakes(name, data, told, tmp_path):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(SceneError, match=told) as caught:
        scene(tmp_path, urdf(name))
    assert "link 'base', collision 1" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_size_that_no_link_has(tmp_path):
    trimesh.creation.box(extents=[100.0, 200.0, 300.0]).export(tmp_path / "box.stl")
    with pytest.raises(SceneError, match="is 300 m large; set its scale, such as"):
        scene(tmp_path, urdf("box.stl"))


def test_a_library_that_is_missing(tmp_path, monkeypatch):
    elbow().export(tmp_path / "elbow.stl")
    monkeypatch.delitem(sys.modules, "cable_ros.scene.mesh_fit")
    monkeypatch.delattr("cable_ros.scene.mesh_fit")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(SceneError, match=r"its mesh needs trimesh; pip install 'cable_ros\[mesh\]'"):
        scene(tmp_path, urdf("elbow.stl"))


@pytest.mark.usefixtures("quick")
def test_a_link_of_a_real_arm(tmp_path):
    """The flange of a UR10, from the package example-robot-data."""
    folder = "cmeel.prefix/share/example-robot-data/robots/ur_description/meshes/ur10/collision"
    files = [Path(place, folder, "wrist3.stl") for place in sys.path]
    file = next((one for one in files if one.is_file()), None)
    if file is None:
        pytest.skip("the extra 'benchmarks' is not installed: example-robot-data, 130 MB")
    found = scene(tmp_path, urdf(file))
    points, _ = trimesh.sample.sample_surface(trimesh.load_mesh(file), 20_000, seed=7)
    least = np.min([distances(one.shape, points) for one in found.obstacles], axis=0)
    assert least.max() <= 1e-9
    assert found.robot.fits[0].outside < 0.015


def test_a_log_opens_no_mesh(tmp_path):
    elbow().export(tmp_path / "elbow.stl")
    clamp = {"position": [0, 5, 0], "orientation": [0, 0, 0, 1]}
    cable = {"name": "c", "length": 1, "stiffness": [1, 1, 1], "linear_density": 0.1, "start": clamp}
    values = {"gravity": [0, 0, 0], "cables": [{**cable, "end": clamp}], "obstacles": [{"robot": {}}]}
    with pytest.raises(SceneError, match="its mesh is a file, which is not opened for a log"):
        load_scene(values, urdf=urdf(tmp_path / "elbow.stl"), meshes=False)


@pytest.mark.usefixtures("quick")
def test_what_the_scene_does_not_ask_for_is_not_fitted_until_told_to(tmp_path):
    """No start of a node waits a minute for advice; `cable compile` fits, and then it is compared."""
    elbow().export(tmp_path / "elbow.stl")
    without = scene(tmp_path, urdf("elbow.stl"), obstacles=())
    told = RobotOverlaps(without, ()).unknown
    assert re.search("Cables are not compared with base: .*has no solids yet; cable compile SCENE", told)
    assert list(fit_meshes(without.robot)) == []
    assert RobotOverlaps(without, ()).unknown == ""

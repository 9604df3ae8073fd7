from __future__ import annotations

import mujoco
import pytest

from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import MujocoSimulator


def test_a_file_and_its_text(bench, tmp_path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(bench.xml)
    for given, name, where in (
        (path, "arm.xml", str(path)),
        (str(path), "arm.xml", str(path)),
        (bench.xml,) + 2 * ("MJCF text",),
    ):
        source = read_source(given)
        assert (source.name, source.path, source.model.nq) == (name, where, 1)
        assert source.spec.compile().names == source.model.names


def test_a_spec_is_copied(bench) -> None:
    spec = mujoco.MjSpec.from_string(bench.xml)
    source = read_source(spec)
    assert (source.name, source.path) == ("pendulum", "an MjSpec")
    source.spec.joints[0].name = "other"
    assert spec.joints[0].name == "hip"


def test_a_model_goes_back_to_mjcf_with_what_was_changed_in_it(bench) -> None:
    model = mujoco.MjModel.from_xml_string(bench.xml)
    model.dof_damping[0] = 0.3
    source = read_source(model)
    assert source.spec.compile().dof_damping[0] == pytest.approx(0.3)
    assert (source.name, source.model.dof_damping[0]) == ("MjModel", 0.3)


def test_the_model_of_a_simulator_is_read(bench) -> None:
    assert read_source(MujocoSimulator(bench.xml)).model.joint(0).name == "hip"


def test_a_simulator_in_torch_is_a_black_box(black) -> None:
    simulator = black.simulator()
    source = read_source(simulator)
    assert (source.name, source.path, source.spec) == ("OdeSimulator", "a OdeSimulator", None)
    assert source.box.simulator is simulator
    assert source.model is source.box.model


@pytest.mark.parametrize("other", ["two joints", "another name"])
def test_a_model_that_was_not_loaded_last_is_refused(bench, other) -> None:
    model = mujoco.MjModel.from_xml_string(bench.xml)
    name = '<joint name="hip" axis="0 1 0"/>'
    more = name + '<joint name="b" axis="1 0 0"/>' if other == "two joints" else name.replace("hip", "hop")
    mujoco.MjModel.from_xml_string(bench.xml.replace(name, more).replace('joint="hip"', f'joint="{more[13:16]}"'))
    with pytest.raises(ConfigurationError, match="MjModel cannot be turned back into MJCF; give the file"):
        read_source(model)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (3.0, "or a Simulator wanted, found a float"),
        ("none.xml", "no file `none.xml`"),
        ("<mujoco><x/></mujoco>", "x"),
    ],
)
def test_anything_else_is_refused(model, words) -> None:
    with pytest.raises(ConfigurationError, match=words):
        read_source(model)


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.parametrize("folder", ["", "assets"])
def test_a_model_finds_its_meshes_from_wherever_it_is_written_to(bench, tmp_path, folder: str) -> None:
    (tmp_path / "robot" / folder).mkdir(parents=True)
    (tmp_path / "robot" / folder / "tip.obj").write_text(TETRAHEDRON)
    compiler = f'<compiler meshdir="{folder}"/>' if folder else ""
    mesh = f'{compiler}<asset><mesh name="tip" file="tip.obj"/></asset><worldbody>'
    xml = bench.xml.replace("<worldbody>", mesh).replace("</body>", '<geom type="mesh" mesh="tip" mass="0"/></body>')
    (tmp_path / "robot" / "arm.xml").write_text(xml)
    source = read_source(tmp_path / "robot" / "arm.xml")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "corrected.xml").write_text(source.spec.to_xml())
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "corrected.xml")).nmesh == 1

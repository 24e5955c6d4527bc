"""Co-simulation units as simulators: a unit of our own C source, compiled here, against the closed form. Skips without fmpy or a C compiler."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

import deadtime

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
import deadtime.fmi  # noqa: E402

VARIABLES = [("u", "input", 0.0, "V"), ("y", "output", None, "rad"), ("gain", "parameter", 2.0, None), ("lag", "parameter", 0.5, "s"), ("x", "local", 0.0, None), ("direct", "parameter", 0.0, None)]


def description(version: str) -> str:
    """modelDescription.xml of tests/python/lag_fmu.c."""
    lines = []
    for reference, (name, causality, start, unit) in enumerate(VARIABLES):
        kind = {"parameter": "tunable"}.get(causality, "continuous")
        more = "" if start is None else f' start="{start}"'
        more += "" if unit is None else f' unit="{unit}"'
        initial = "calculated" if causality == "output" else "exact"
        initial = "" if causality == "input" else f' initial="{initial}"'
        common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{kind}"{initial}'
        lines.append(f"<Float64 {common}{more}/>" if version == "3.0" else f"<ScalarVariable {common}><Real{more}/></ScalarVariable>")
    if version == "3.0":
        lines.append('<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>')
    units = "".join(f'<Unit name="{unit}"/>' for unit in ("V", "rad", "s"))
    outputs = '<Output valueReference="1"/>' if version == "3.0" else '<Outputs><Unknown index="2"/></Outputs><InitialUnknowns><Unknown index="2"/></InitialUnknowns>'
    guid = "instantiationToken" if version == "3.0" else "guid"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{version}" modelName="lag" {guid}="{{1}}">'
        f'<CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/><UnitDefinitions>{units}</UnitDefinitions>'
        f"<ModelVariables>{''.join(lines)}</ModelVariables><ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def unit(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler here")
    folder, version = tmp_path_factory.mktemp("fmu"), request.param
    library = folder / f"lag{fmpy.sharedLibraryExtension}"
    subprocess.run([compiler, "-O1", "-shared", "-fPIC", str(Path(__file__).with_name("lag_fmu.c")), "-lm", "-o", str(library)], check=True)
    platform = fmpy.platform_tuple if version == "3.0" else fmpy.platform
    path = folder / "lag.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description(version))
        archive.write(library, f"binaries/{platform}/{library.name}")
    return path


def closed_form(u: np.ndarray, time: np.ndarray, x: float, gain: float, lag: float, direct: float = 0.0) -> np.ndarray:
    """x' = (gain u - x)/lag with u held, y = x + direct u."""
    y = []
    for k, at in enumerate(u):
        y.append(x + direct * at)
        if k + 1 < len(u):
            x = gain * at + (x - gain * at) * np.exp(-(time[k + 1] - time[k]) / lag)
    return np.array(y)


def test_a_unit_answers_as_the_closed_form_for_held_commands(unit: Path) -> None:
    made = deadtime.fmi.simulator(unit, "u", ["y"], ["gain", "lag", "direct"], {"x": (0.0, 0.1)})
    assert made["inputs"] == {"u": "V"} and made["outputs"] == {"y": "rad"} and made["name"] == "lag"
    assert made["parameters"] == {"gain": (2.0, None), "lag": (0.5, "s"), "direct": (0.0, None)}
    rng = np.random.default_rng(1)
    time, u = np.cumsum(rng.uniform(0.01, 0.05, 200)), rng.normal(size=(200, 1))
    for parameters, x0 in (({"gain": 2.0, "lag": 0.5, "direct": 0.0}, 0.0), ({"gain": -1.0, "lag": 0.2, "direct": 0.3}, 0.7)):
        y = made["simulate"](u, time, np.array([x0]), parameters)
        np.testing.assert_allclose(y[:, 0], closed_form(u[:, 0], time, x0, **parameters), rtol=0, atol=1e-12)
    # Shorter communication steps end at the same samples.
    fine = deadtime.fmi.simulator(unit, "u", ["y", "x"], states={"x": (0.0, None)}, step=0.004)
    y = fine["simulate"](u, time, np.array([0.0]), {})
    np.testing.assert_allclose(y[:, 1], closed_form(u[:, 0], time, 0.0, 2.0, 0.5), rtol=0, atol=1e-12)


def test_the_gain_that_the_machine_has_is_found_in_a_unit(unit: Path) -> None:
    rng = np.random.default_rng(2)
    time = 0.02 * np.arange(600)
    u = np.repeat(rng.choice([-1.0, 1.0], 60), 10)
    y = closed_form(u, time, 0.0, 2.0, 0.8) + 0.01 * rng.normal(size=600)
    log = deadtime.Log(time, {"u": u, "y": y}, {"u": "V", "y": "rad"})
    found = deadtime.gap(log=log, **deadtime.fmi.simulator(unit, "u", "y", ["gain", "lag"], {"x": (0.0, 0.1)}))
    assert found.verdict == "parameter_error"
    assert found.effects[0]["channel"] == "lag"


def test_names_that_a_unit_does_not_have_are_refused_with_those_that_it_has(unit: Path, tmp_path: Path) -> None:
    for arguments, says in (
        (("v", "y"), "no input 'v' that is a real number; it has u"),
        (("u", "z"), "no output 'z'"),
        (("u", "y", ["x"]), "no parameter 'x'"),
        (("u", "y", [], {"u": (0.0, None)}), "no state 'u'"),
    ):
        with pytest.raises(ValueError, match=says):
            deadtime.fmi.simulator(unit, *arguments)
    with pytest.raises(ValueError, match="seconds above 0"):
        deadtime.fmi.simulator(unit, "u", "y", step=0.0)
    exchanged = tmp_path / "exchange.fmu"
    with zipfile.ZipFile(unit) as there, zipfile.ZipFile(exchanged, "w") as archive:
        text = there.read("modelDescription.xml").decode().replace("CoSimulation", "ModelExchange").replace(' canHandleVariableCommunicationStepSize="true"', "")
        archive.writestr("modelDescription.xml", text)
    with pytest.raises(ValueError, match="no co-simulation unit"):
        deadtime.fmi.simulator(exchanged, "u", "y")

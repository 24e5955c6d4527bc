"""Parameters of a model file from Python: by time from logs, by frequency from what was identified."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy
import pytest

import deadtime

#: A mass on a spring: what is known of it are its eigenfrequency, its damping and its gain, not mass and spring apart.
SPRING: dict[str, Any] = {
    "format": "deadtime/model@1",
    "name": "spring",
    "kind": "equations",
    "inputs": [{"name": "force", "unit": "N"}],
    "outputs": [{"name": "position", "unit": "m"}, {"name": "speed", "unit": "m/s"}],
    "states": {"position": {"unit": "m"}, "speed": {"unit": "m/s"}},
    "parameters": {"mass": {"value": 1.0}, "spring": {"value": 8.0}, "friction": {"value": 0.3}, "gain": {"value": 1.0}},
    "derivatives": {"position": "speed", "speed": "(gain*force - spring*position - friction*speed)/mass"},
    "output_equations": {"position": "position", "speed": "speed"},
}
TRUTH = {"mass": 1.0, "spring": 11.0, "friction": 0.5, "gain": 1.4}
STEP_S = 0.05


def flight(samples: int, seed: int, noise: float = 2e-3) -> dict[str, numpy.ndarray]:
    """Sampled exactly behind a hold, by the matrix exponential of scipy."""
    import scipy.signal

    p = TRUTH
    A = numpy.array([[0.0, 1.0], [-p["spring"] / p["mass"], -p["friction"] / p["mass"]]])
    B = numpy.array([[0.0], [p["gain"] / p["mass"]]])
    a, b, *_ = scipy.signal.cont2discrete((A, B, numpy.eye(2), numpy.zeros((2, 1))), STEP_S)
    generator = numpy.random.default_rng(seed)
    force = numpy.repeat(generator.choice([-1.0, 1.0], samples // 5 + 1), 5)[:samples]
    x, seen = numpy.zeros(2), numpy.zeros((samples, 2))
    for t in range(samples):
        seen[t] = x
        x = a @ x + b[:, 0] * force[t]
    seen += noise * generator.standard_normal(seen.shape)
    return {"time": STEP_S * numpy.arange(samples), "force": force, "position": seen[:, 0], "speed": seen[:, 1]}


def test_a_search_whose_iterations_run_out_is_continued(examples: Path) -> None:
    # The speed is in rpm where the model has rad/s: the minimum is far away, in a flat valley.
    fit = deadtime.identify_structure(examples / "drive_run_1.csv", examples / "drive.toml", ["all"], horizon=50)
    assert fit.converged and fit.determined < 4.0


def test_parameters_are_fitted_to_logs_and_judged_on_others(tmp_path: Path) -> None:
    logs = [flight(800, 1), flight(700, 2)]
    fit = deadtime.identify_structure(logs, SPRING, ["spring", "friction", "gain"], horizon=40, holdout=flight(600, 3))
    assert fit.converged and not fit.cannot_be_had
    assert 0.0 < fit.determined <= 3.0
    for name in ("spring", "friction", "gain"):
        found = fit.parameters[name]
        assert found.ci95 is not None and found.std is not None
        assert abs(fit[name] - TRUTH[name]) < 4 * found.std and found.std < 0.03 * TRUTH[name], found
        assert found.ci95[0] < fit[name] < found.ci95[1] and found.nominal == SPRING["parameters"][name]["value"]
    assert "spring" in repr(fit) and fit.to_dict()["format"] == "deadtime/structure@1"
    before, after = (groups[0]["sum"] for groups in fit.to_dict()["held_out"])
    assert after < 0.2 * before
    fit.model.write(tmp_path / "fitted.toml")
    assert deadtime.Model.read(tmp_path / "fitted.toml") == fit.model
    # Mass, spring, friction and gain together are known up to a factor only.
    whole = deadtime.identify_structure(logs, SPRING, "all", horizon=40)
    assert whole.cannot_be_had and "mass" in whole.cannot_be_had[0]
    assert whole.parameters["mass"].standing == "open"


def test_a_linear_model_has_the_entries_of_its_matrices_and_keeps_its_operating_point() -> None:
    log = flight(800, 4)
    log["force"] = log["force"] + 3.0
    log["position"] = log["position"] + 20.0
    model = deadtime.Model.from_system(
        (numpy.array([[0.0, 1.0], [-8.0, -0.3]]), numpy.array([[0.0], [1.0]]), numpy.eye(2), numpy.zeros((2, 1))),
        inputs=["force"],
        outputs=["position", "speed"],
        states=["x", "v"],
        operating={"force": 3.0, "position": 20.0},
    )
    # States of other names start where the window fits best, those of the columns' names at the log's rows.
    for x, v in (("x", "v"), ("position", "speed")):
        named = deadtime.Model.from_dict(model.to_dict() | {"states": [{"name": x}, {"name": v}]})
        fit = deadtime.identify_structure(log, named, "all" if x == "x" else [f"A_{v}_{x}", f"A_{v}_{v}", f"B_{v}_force"], horizon=60)
        for name, truth in ((f"A_{v}_{x}", -11.0), (f"A_{v}_{v}", -0.5), (f"B_{v}_force", 1.4)):
            std = fit.parameters[name].std
            assert std is not None and 1e-5 < std < 0.02 and abs(fit[name] - truth) < 4 * std, fit
        # Errors are told from the best start, and are those of the noise.
        assert all(group["rms"][-1] < 3e-3 * (3 if x == "position" else 1) for group in fit.to_dict()["training"][1]), fit
    with pytest.raises(deadtime.errors.ModelError, match="name of an output that is another quantity"):
        deadtime.identify_structure(log, deadtime.Model.from_dict(model.to_dict() | {"states": [{"name": "speed"}, {"name": "v"}]}), "all")
    with pytest.raises(deadtime.errors.ModelError, match='operating point of `force` is "mean"'):
        deadtime.identify_structure(log, deadtime.Model.from_dict(model.to_dict() | {"inputs": [{"name": "force", "operating": "mean"}]}), "all")


def test_an_identified_model_gives_physical_parameters_with_intervals(tmp_path: Path) -> None:
    found = deadtime.identify(flight(4000, 5), "force", ["position", "speed"], order=2, delay="none")
    match = deadtime.match_structure(found, SPRING, ["spring", "friction", "gain"])
    for name in ("spring", "friction", "gain"):
        std = match.parameters[name].std
        assert std is not None and abs(match[name] - TRUTH[name]) < 5 * std, match
    assert match.nu_gap is not None and match.nu_gap < 0.05 and match.to_dict()["format"] == "deadtime/match@1"
    # The model file says nothing of its uncertainty.
    found.save(tmp_path / "found.toml")
    bare = deadtime.match_structure(tmp_path / "found.toml", SPRING, "all", starts=2)
    assert bare.parameters["spring"].std is None and any("no intervals" in note for note in bare.notes)
    assert bare.cannot_be_had
    again = deadtime.match_structure(found.model, SPRING, ["spring", "friction", "gain"], norm="h2", band_rad_s=(0.5, 20.0), units={"speed": 2.0})
    assert abs(again["spring"] - TRUTH["spring"]) < 0.3


def test_what_cannot_be_is_said() -> None:
    log = flight(200, 6)
    with pytest.raises(deadtime.errors.ModelError, match="no parameter `inertia`"):
        deadtime.identify_structure(log, SPRING, "inertia")
    with pytest.raises(deadtime.errors.ModelError, match="no parameter is free"):
        deadtime.identify_structure(log, SPRING, [])
    with pytest.raises(deadtime.errors.ModelError, match="no window of 500 steps"):
        deadtime.identify_structure(log, SPRING, "all", horizon=500)
    with pytest.raises(ValueError, match="horizon is 0"):
        deadtime.identify_structure(log, SPRING, "all", horizon=0)
    with pytest.raises(ValueError, match="balance is 'all'"):
        deadtime.identify_structure(log, SPRING, "all", balance="all")  # type: ignore[arg-type]
    with pytest.raises(deadtime.errors.RegistryError, match="hinf"):
        deadtime.match_structure(deadtime.Model.from_system(([1.0], [1.0, 1.0]), inputs=["force"], outputs=["speed"]), SPRING, "all", norm="h3")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="one of equations"):
        deadtime.match_structure(deadtime.Model.from_dict(SPRING), SPRING, "all")

"""Frequency responses from logs: what `frequency_response` gives is the command line's, as arrays."""

from __future__ import annotations

import numpy
import pytest

import deadtime


def test_the_response_of_a_known_plant_is_found_as_arrays() -> None:
    generator = numpy.random.default_rng(3)
    u, y = generator.standard_normal(4000), numpy.zeros(4000)
    for t in range(3, 4000):
        y[t] = 0.7 * y[t - 1] + 0.3 * u[t - 3]
    log = {"time": 0.05 * numpy.arange(4000), "u": u, "y": y + 0.05 * generator.standard_normal(4000)}
    for method in ("lpm", "welch"):
        found = deadtime.frequency_response(log, "u", "y", method=method)
        shape = (1, 1, len(found.frequency_hz))
        assert found.response.shape == found.std.shape == found.coherence.shape == shape and found.gain_ci95.shape == (*shape, 2)
        z = numpy.exp(-1j * found.omega_rad_s * found.sample_time_s)
        off = numpy.abs(found.response[0, 0] - 0.3 * z**3 / (1 - 0.7 * z))
        # Most errors are within three standard deviations of two parts.
        assert numpy.mean(off < 3 * numpy.sqrt(2) * found.std[0, 0]) > 0.9
        assert found.to_dict()["format"] == "deadtime/response@1" and found.method == method
        delay = deadtime.estimate_frf(found.omega_rad_s, found.response[0, 0], coherence=found.coherence[0, 0], max_delay=1)
        assert delay.verdict.delay_s == pytest.approx(0.15, abs=0.03)


def test_it_goes_to_python_control() -> None:
    control = pytest.importorskip("control")
    found = deadtime.frequency_response("examples/two_inputs.csv", ["heater", "fan"], "temperature")
    theirs = found.to_control()
    assert isinstance(theirs, control.FrequencyResponseData) and theirs.ninputs == 2


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(deadtime.errors.LogError):
        deadtime.frequency_response("examples/two_inputs.csv", "heater", "humidity")
    with pytest.raises(deadtime.errors.RegistryError, match="welch"):
        deadtime.frequency_response("examples/two_inputs.csv", "heater", "temperature", method="welsh")  # type: ignore[arg-type]

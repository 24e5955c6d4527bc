"""Every golden file: case folder -> file name -> function of the committed document (or None) that builds it anew."""

from functools import partial

from . import c2d_cases as c2d
from . import equations_cases as equations
from . import effect_cases
from . import regression_cases as regression
from . import riccati_cases as riccati
from . import simulation_cases as simulation
from . import subspace_cases
from . import balance_cases
from . import correlation_cases
from . import event_cases
from . import frf_cases
from . import norm_cases
from . import signal_cases
from . import ode_cases
from . import parametric_cases
from . import process_cases
from . import response_cases
from . import zeros_cases as zeros

CASES = {
    "ode": {"reference.json": ode_cases.ode},
    "delays_events": {"reference.json": event_cases.events},
    "signals": {"reference.json": signal_cases.signals},
    "delays_response": {"reference.json": response_cases.response},
    "delays_process": {"reference.json": process_cases.process},
    "delays_parametric": {"reference.json": parametric_cases.parametric},
    "delays_frf": {"reference.json": frf_cases.frf},
    "delays_correlation": {"reference.json": correlation_cases.correlation},
    "c2d_zoh": {"reference.json": partial(c2d.held_method, "zoh"), "octave.json": c2d.octave_file("zoh")},
    "c2d_foh": {"reference.json": partial(c2d.held_method, "foh"), "octave.json": c2d.octave_file("foh")},
    "c2d_impulse": {"reference.json": c2d.impulse},
    "c2d_tustin": {"reference.json": c2d.tustin, "octave.json": c2d.octave_file("tustin")},
    "c2d_matched": {"reference.json": c2d.matched, "octave.json": c2d.octave_file("matched")},
    "c2d_least_squares": {"reference.json": c2d.least_squares},
    "d2c_zoh": {"reference.json": simulation.d2c_zoh},
    "lsim": {"reference.json": simulation.lsim},
    "equations": {"reference.json": equations.equations},
    "dlqr": {"reference.json": riccati.dlqr, "octave.json": riccati.dlqr_octave},
    "dlqr_random": {"reference.json": riccati.dlqr_random},
    "lyapunov": {"reference.json": balance_cases.lyapunov},
    "dlqr_far": {"reference.json": riccati.dlqr_far},
    "effects": {"reference.json": effect_cases.effects},
    "regression": {"reference.json": regression.regression},
    "subspace": {"reference.json": subspace_cases.subspace, "octave.json": subspace_cases.by_octave},
    "norms": {"reference.json": norm_cases.norms},
    "zeros": {"reference.json": zeros.zeros},
    "polynomials": {"reference.json": balance_cases.polynomials},
    "balance": {"reference.json": balance_cases.balance},
}

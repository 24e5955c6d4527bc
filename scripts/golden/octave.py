"""Runs Octave's control package on literal matrices and reads its numbers back with 17 digits."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

PRELUDE = """1;
pkg load control
more off
warning('off', 'all');
function put(name, m)
  m = full(m);
  printf('@ %s %d %d', name, rows(m), columns(m));
  printf(' %.17g', [real(m.'(:)), imag(m.'(:))].');
  printf('\\n');
end
function put_response(name, sys, w)
  h = squeeze(freqresp(sys, w));
  if rows(h) == numel(w), h = h.'; end
  put(name, h.');
end
function put_model(name, sys, w)
  [a, b, c, d] = ssdata(sys);
  put([name '.A'], a); put([name '.B'], b); put([name '.C'], c); put([name '.D'], d);
  put_response([name '.h'], sys, w);
end
"""


class Unavailable(Exception):
    """Octave or its control package is missing."""


def literal(value) -> str:
    """An Octave matrix literal with every digit."""
    value = np.atleast_1d(np.asarray(value, dtype=float))
    if value.ndim == 1:
        value = value[None, :]
    return "[" + ";".join(",".join(repr(float(v)) for v in row) for row in value) + "]"


def run(script: str) -> dict[str, np.ndarray]:
    """Complex matrices by name, as printed with put()."""
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        raise Unavailable
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "golden_script.m"
        file.write_text(PRELUDE + script + "\n", encoding="utf-8")
        done = subprocess.run(
            [program, "--no-gui", "--norc", "--quiet", str(file)], capture_output=True, text=True, check=False
        )
    if "pkg" in done.stderr and "control" in done.stderr and "@ " not in done.stdout:
        raise Unavailable
    if "error:" in done.stderr.replace("error: ignoring const execution_exception", ""):
        raise RuntimeError(done.stderr)
    found = {}
    for line in done.stdout.splitlines():
        if line.startswith("@ "):
            _, name, rows, columns, *numbers = line.split()
            pairs = np.array(numbers, dtype=float).reshape(-1, 2)
            found[name] = (pairs[:, 0] + 1j * pairs[:, 1]).reshape(int(rows), int(columns))
    return found


def versions() -> str:
    """ "Octave 7.3.0, control 3.4.0"."""
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        raise Unavailable
    ask = "pkg load control; p = pkg('list', 'control'); printf('Octave %s, control %s\\n', version(), p{1}.version);"
    done = subprocess.run([program, "--no-gui", "--norc", "--quiet"], input=ask, capture_output=True, text=True, check=False)
    answer = re.search(r"Octave \S+, control \S+", done.stdout)
    if answer is None:
        raise Unavailable
    return answer.group(0)

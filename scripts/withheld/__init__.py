"""An independent reference simulator of deadtime's models with effects, and the generator of blind cases.

Nothing here shares code with the crate. What FORMATS.md leaves open is fixed as follows.

- Log time counts from the first sample; u(t) = u[k] on [t_k, t_k+1), u[0] before, the last value after the end; at an edge a
  signal has its value from the right. Times closer than 1e-9 sample times are one.
- Input effects act on the logged command, before `operating` is taken off; output effects with it added. A model's
  `input_delay_s` adds to the effect. Gain and curve act on the same delayed command: gain*u + quadratic*u*|u|. A cross coupling
  from an input is an entry of B that the model lacks, so it acts on u - operating.
- Lags, the rate limit, the play and modes start settled on their input at t = 0. Modes on states and outputs are driven by the
  input after all input effects. Misalignments act at once on the values before them.
- A sample stamped s was taken at t = (s - offset)/ratio - delay of the commands' clock, at 0 if that is negative; the drift counts stamps.
- A sampled model receives the mean of the effective input over [t_k, t_k+1), its D the effective input at t_k; between samples
  its outputs run linearly. Dynamics effects on it are refused.
- A command that a delay which jumps or drifts brings is that of t - delay(t), heard again where the delay grew; random delays are gamma draws, the first command has none; a slower loop reads
  before the fixed delay, and its first reading may come after the start.
- Friction adds -level*sign(x) while x != 0 and holds x at exactly 0 while the rest of the derivative is no larger than the level.
  Friction that falls with speed is held at rest by level + extra.
"""

import os

# One thread: the matrices are small. Set before numpy is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

//! Zero-order hold: exact where the input is held between samples.

use nalgebra::DMatrix;

use super::conversion::{Conversion, Converted};
use super::hold::{Hold, delayed_taps, transition};
use crate::error::ModelError;
use crate::state_space::{Continuous, Sampled, StateSpace};
use deadtime_signal::time::SampleTime;

/// x(k+1) = Φx(k) + Γ₀u(k−d) + Γ₁u(k−d−1), exact for held inputs and any delay (d+f)·Ts.
///
/// A fractional delay adds one state, the input one sample ago, per delayed input.
/// Source: Åström and Wittenmark (1997), "Computer-Controlled Systems", 3rd ed., section 2.3.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZeroOrderHold {}

impl Conversion for ZeroOrderHold {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        exact(sys, sample_time, Hold::Zero)
    }

    fn keeps_states(&self) -> bool {
        true
    }
}

/// The exact sampled model for held or interpolated inputs.
pub(super) fn exact(
    sys: &StateSpace<Continuous>,
    sample_time: SampleTime,
    hold: Hold,
) -> Result<StateSpace<Sampled>, ModelError> {
    let ts = sample_time.seconds();
    let (n, m) = (sys.order(), sys.inputs());
    let delays =
        sys.input_delay().iter().map(|&d| sample_time.samples(d)).collect::<Result<Vec<_>, _>>()?;
    let whole: Vec<usize> = delays.iter().map(|d| d.whole).collect();
    if delays.iter().all(|d| d.fraction == 0.0) {
        let (phi, held, ramp) = transition(sys.a(), sys.b(), ts, hold);
        let (b, d) = match hold {
            Hold::Zero => (held, sys.d().clone()),
            Hold::Linear => (&phi * &ramp + &held - &ramp, sys.d() + sys.c() * &ramp),
        };
        return StateSpace::sampled(phi, b, sys.c().clone(), d, sample_time)?
            .with_input_delay(whole);
    }
    let stored: Vec<usize> = (0..m).filter(|&j| delays[j].fraction > 0.0).collect();
    let phi = transition(sys.a(), sys.b(), ts, Hold::Zero).0;
    let order = n + stored.len();
    let mut a = DMatrix::zeros(order, order);
    a.view_mut((0, 0), (n, n)).copy_from(&phi);
    let mut b = DMatrix::zeros(order, m);
    let mut c = DMatrix::zeros(sys.outputs(), order);
    c.view_mut((0, 0), (sys.outputs(), n)).copy_from(sys.c());
    let mut d = DMatrix::zeros(sys.outputs(), m);
    for j in 0..m {
        let memory = stored.iter().position(|&r| r == j).map(|at| n + at);
        if let Some(memory) = memory {
            b[(memory, j)] = 1.0;
        }
        for tap in delayed_taps(sys.a(), sys.b().column(j), ts, delays[j], hold) {
            let direct = sys.d().column(j) * tap.direct;
            match (tap.lag, memory) {
                // A term in u[k+1] moves into the state: z = x − Γu.
                (-1, _) => {
                    let mut upper = b.view_mut((0, j), (n, 1));
                    upper += &phi * &tap.gamma;
                    let mut column = d.column_mut(j);
                    column += sys.c() * &tap.gamma;
                }
                (1, Some(memory)) => {
                    let mut upper = a.view_mut((0, memory), (n, 1));
                    upper += &tap.gamma;
                    let mut column = c.column_mut(memory);
                    column += direct;
                }
                _ => {
                    let mut upper = b.view_mut((0, j), (n, 1));
                    upper += &tap.gamma;
                    let mut column = d.column_mut(j);
                    column += direct;
                }
            }
        }
    }
    StateSpace::sampled(a, b, c, d, sample_time)?.with_input_delay(whole)
}

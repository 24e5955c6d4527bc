//! The effect of a held or interpolated, delayed input on the state over one sample: shared by the exact conversions and by `lsim`.

use nalgebra::{DMatrix, DVector, DVectorView};

use crate::matrix::exp;
use deadtime_signal::time::Samples;

/// The input between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// u(k) holds on [t_k, t_k+1) (zero-order hold).
    #[default]
    Zero,
    /// A straight line from u(k) to u(k+1) (first-order, triangle hold).
    Linear,
}

/// One term of a delayed input: Γ·u(k − lag) in x(k+1) = Φx(k) + Σ Γ u(k − lag). In y(k) = C x(k) + D Σ `direct`·u(k − lag) its weight is `direct`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tap {
    /// Lag of the term, samples; −1 refers to u(k + 1).
    pub lag: isize,
    /// Γ, one entry per state.
    pub gamma: DVector<f64>,
    /// The term's weight in the delayed input at the sampling instant itself.
    pub direct: f64,
}

/// Φ = exp(A·h), and for one input column the integrals of a held value and of a ramp from 0 to 1 over h.
struct Step {
    held: DVector<f64>,
    ramp: DVector<f64>,
    phi: DMatrix<f64>,
}

fn step(a: &DMatrix<f64>, b: DVectorView<'_, f64>, h: f64) -> Step {
    let n = a.nrows();
    let mut block = DMatrix::zeros(n + 2, n + 2);
    block.view_mut((0, 0), (n, n)).copy_from(&(a * h));
    block.view_mut((0, n), (n, 1)).copy_from(&(b * h));
    block[(n, n + 1)] = 1.0;
    let e = exp(&block);
    Step {
        phi: e.view((0, 0), (n, n)).into_owned(),
        held: e.view((0, n), (n, 1)).column(0).into_owned(),
        ramp: e.view((0, n + 1), (n, 1)).column(0).into_owned(),
    }
}

/// Φ and, for all undelayed inputs at once, the integrals of held inputs and of ramps: each n×m.
pub fn transition(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    h: f64,
    hold: Hold,
) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = b.shape();
    let blocks = match hold {
        Hold::Zero => 1,
        Hold::Linear => 2,
    };
    let mut block = DMatrix::zeros(n + blocks * m, n + blocks * m);
    block.view_mut((0, 0), (n, n)).copy_from(&(a * h));
    block.view_mut((0, n), (n, m)).copy_from(&(b * h));
    if hold == Hold::Linear {
        block.view_mut((n, n + m), (m, m)).fill_with_identity();
    }
    let e = exp(&block);
    let phi = e.view((0, 0), (n, n)).into_owned();
    let held = e.view((0, n), (n, m)).into_owned();
    let ramp = if hold == Hold::Linear {
        e.view((0, n + m), (n, m)).into_owned()
    } else {
        DMatrix::zeros(0, 0)
    };
    (phi, held, ramp)
}

/// The taps of one input whose delay has this fraction; lags count from the delay's whole part.
///
/// Zero-order hold (Åström and Wittenmark 1997, "Computer-Controlled Systems", section 2.3): u(k−1) acts until the fraction has passed, then u(k). First-order
/// hold: the delayed straight lines meet at the end of the fraction.
pub fn delayed_taps(
    a: &DMatrix<f64>,
    b: DVectorView<'_, f64>,
    ts: f64,
    delay: Samples,
    hold: Hold,
) -> Vec<Tap> {
    let f = delay.fraction;
    let late = step(a, b, ts * (1.0 - f));
    let early = if f > 0.0 { Some(step(a, b, ts * f)) } else { None };
    match (hold, early) {
        (Hold::Zero, None) => vec![Tap { lag: 0, gamma: late.held, direct: 1.0 }],
        (Hold::Zero, Some(early)) => {
            vec![
                Tap { lag: 0, gamma: late.held, direct: 0.0 },
                Tap { lag: 1, gamma: &late.phi * early.held, direct: 1.0 },
            ]
        }
        (Hold::Linear, None) => {
            vec![
                Tap { lag: -1, gamma: late.ramp.clone(), direct: 0.0 },
                Tap { lag: 0, gamma: late.held - late.ramp, direct: 1.0 },
            ]
        }
        (Hold::Linear, Some(early)) => {
            // Until the fraction ends: from (1−f)u[k] + f·u[k−1] to u[k]. After it: from u[k] to (1−f)u[k+1] + f·u[k].
            let fading = &late.phi * (&early.held - &early.ramp);
            let rising = &late.phi * &early.ramp;
            vec![
                Tap { lag: -1, gamma: &late.ramp * (1.0 - f), direct: 0.0 },
                Tap {
                    lag: 0,
                    gamma: &fading * (1.0 - f)
                        + rising
                        + (&late.held - &late.ramp)
                        + &late.ramp * f,
                    direct: 1.0 - f,
                },
                Tap { lag: 1, gamma: fading * f, direct: f },
            ]
        }
    }
}

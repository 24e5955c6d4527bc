//! A subspace model of the same order: a further start of a search, and the reference for its result.

use nalgebra::Complex;

use crate::subspace::identifier::{Identifier, Pbsidopt, Settings};
use crate::subspace::recordings::Recordings;
use deadtime_signal::progress::HowFar;

/// An output error above this multiple of the subspace model's power indicates another minimum.
pub(crate) const FAR: f64 = 2.0;

/// A subspace model of one output.
pub(crate) struct Rival {
    /// Its poles, in the z plane.
    pub(crate) poles: Vec<Complex<f64>>,
    /// The mean square of its free-run errors, with an output of standard deviation 1; infinite for an unstable model.
    pub(crate) mean_square: f64,
}

impl Rival {
    /// The model of this many states, behind these input delays, samples.
    pub(crate) fn of(used: &Recordings, delays: &[usize], order: usize) -> Option<Self> {
        let behind = used.behind_delays(delays).ok()?;
        let settings = Settings { order: Some(order), draws: 0, ..Settings::default() };
        let found = Pbsidopt(settings).identify(&behind, &HowFar::default()).ok()?;
        let poles: Vec<_> = found.poles().iter().map(|p| Complex::new(p.re, p.im)).collect();
        let spread = used.scales().ok()?.outputs.first()?.1;
        let (mut error, mut rows) = (0.0, 0);
        for s in &behind.stretches {
            let centred = found.scales.centred(s);
            let left = (&centred.y - found.model.free_run(&centred)) / spread;
            let mean = left.mean();
            error += left.iter().map(|e| (e - mean).powi(2)).sum::<f64>();
            rows += left.len();
        }
        let mean_square = error / rows.max(1) as f64;
        let stable = poles.iter().all(|p| p.norm() < 1.0) && mean_square.is_finite();
        Some(Self { poles, mean_square: if stable { mean_square } else { f64::INFINITY } })
    }
}

/// c₁ … of Π (1 − pole·q⁻¹).
pub(crate) fn polynomial(poles: impl Iterator<Item = Complex<f64>>) -> Vec<f64> {
    let mut all = vec![Complex::new(1.0, 0.0)];
    for pole in poles {
        all.push(Complex::new(0.0, 0.0));
        for i in (1..all.len()).rev() {
            let below = all[i - 1];
            all[i] -= pole * below;
        }
    }
    all.iter().skip(1).map(|c| c.re).collect()
}

//! A process model fitted by least squares, and one further step to the estimate under the noise's own colour.

use deadtime_identify::{Coloured, coloured};
use deadtime_signal::stats::interval95;

/// A fit by least squares, time in samples.
pub(super) struct Solved {
    /// ln T₁, or ln a and ρ (see `chain`); the delay; K; the zero's parameter. For an integrator K and the slope of a wrong operating input.
    pub(super) values: Vec<f64>,
    /// Derivatives of the model by these, then by the other fitted parameters, all records in a row; zeros for a parameter treated as fixed.
    pub(super) jacobian: Vec<Vec<f64>>,
    /// y − ŷ.
    pub(super) residual: Vec<f64>,
    /// Samples of each record.
    pub(super) lengths: Vec<usize>,
    /// The 95 % interval of the delay, where it is not from the covariance.
    pub(super) delay: Option<[f64; 2]>,
    /// The noise, and the covariance under it; absent where the parameters are indistinguishable.
    pub(super) noise: Option<Coloured>,
    /// Input and output of the operating point.
    pub(super) operating: [f64; 2],
    pub(super) notes: Vec<String>,
}

/// A step of a logarithm or of the delay, samples, beyond which linearisation fails.
const LONG: f64 = 0.5;

impl Solved {
    /// One further step to the estimate under the noise's own colour, unless it exceeds [`LONG`]; always the covariance. `levels`: the derivatives contain no
    /// offset of each record.
    pub(super) fn weigh(&mut self, poles: usize, levels: bool) {
        self.noise = coloured(&self.jacobian, &self.residual, &self.lengths, levels);
        let Some(noise) = &self.noise else { return };
        if noise.change.iter().take(poles + 1).all(|v| v.abs() < LONG) {
            let moved = self.values[poles];
            for (value, change) in self.values.iter_mut().zip(&noise.change) {
                *value += change;
            }
            self.values[poles] = self.values[poles].max(0.0);
            // The delay's interval moves with it, and is at least that of the covariance.
            let (delay, std) =
                (self.values[poles], noise.covariance[(poles, poles)].max(0.0).sqrt());
            let [low, high] = interval95(delay, std);
            self.delay = self.delay.map(|[from, to]| {
                [(from + delay - moved).min(low).max(0.0), (to + delay - moved).max(high)]
            });
            self.residual.clone_from(&noise.residual);
        }
    }
}

//! A process model by itself: its response and derivatives, for bounds.

use super::chain::{Chain, Row, Shape};
use super::fit::{Place, combine};
use deadtime_signal::time::SampleTime;

/// K(1 + T_z·s)/((1 + T₁s)…)·e^(−τs) with one to three real poles.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessModel {
    /// K.
    pub gain: f64,
    /// The time constants, s, each above 0.
    pub lags_s: Vec<f64>,
    /// T_z, s, where there is a zero.
    pub zero_s: Option<f64>,
    /// τ, s.
    pub delay_s: f64,
}

/// A response from rest and its derivatives, one value per sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Slopes {
    /// ŷ.
    pub response: Vec<f64>,
    /// ∂ŷ/∂τ, per second.
    pub by_delay: Vec<f64>,
    /// Derivatives by gain, zero and poles: they span the effect of small changes of these parameters.
    pub by_others: Vec<Vec<f64>>,
}

impl ProcessModel {
    /// The response to a held input, and its derivatives. `None` unless there are one to three time constants, all above 0, and a delay not below 0.
    #[must_use]
    pub fn slopes(&self, u: &[f64], sample_time: SampleTime) -> Option<Slopes> {
        let step = sample_time.seconds();
        let lags: Vec<f64> = self.lags_s.iter().map(|l| l / step).collect();
        let usable = |v: &f64| v.is_finite() && *v > 0.0;
        if !((1..=3).contains(&lags.len())
            && lags.iter().all(usable)
            && self.delay_s.is_finite()
            && self.delay_s >= 0.0)
        {
            return None;
        }
        let shape = Shape { poles: lags.len(), zero: self.zero_s.is_some() };
        let theta = match lags.as_slice() {
            [a] => vec![a.ln()],
            [a, b, rest @ ..] => [(a + b).ln(), a * b / (a + b).powi(2)]
                .into_iter()
                .chain(rest.iter().map(|c| c.ln()))
                .collect(),
            [] => return None,
        };
        // The zero's signal is in units of the only time constant, or of √(T₁T₂).
        let unit =
            lags.iter().take(2).product::<f64>().powf(1.0 / if lags.len() > 1 { 2.0 } else { 1.0 });
        let weights = [self.gain, self.gain * self.zero_s.unwrap_or(0.0) / step / unit];
        let chain = Chain::new(shape, &theta);
        let place = Place::of(self.delay_s / step);
        let states = chain.states(u, &[]);
        let read = |rows: &[Row]| -> Vec<Vec<f64>> {
            chain
                .after(place.g, rows)
                .iter()
                .map(|row| {
                    let mut to = vec![0.0; u.len()];
                    combine(row, &states, u, place.lag, None, &mut to);
                    to
                })
                .collect()
        };
        let sum = |columns: &[Vec<f64>]| -> Vec<f64> {
            (0..u.len()).map(|t| columns.iter().zip(weights).map(|(c, w)| w * c[t]).sum()).collect()
        };
        let basis = read(&chain.basis);
        let rates: Vec<_> = chain.basis.iter().map(|r| chain.rate(r)).collect();
        let by_delay = sum(&read(&rates)).iter().map(|v| -v / step).collect();
        let by_poles = (0..shape.denominator()).map(|j| {
            let rows: Vec<_> = chain.slopes.iter().map(|of| of[j]).collect();
            sum(&read(&rows))
        });
        let response = sum(&basis);
        let by_others = by_poles.collect::<Vec<_>>().into_iter().chain(basis).collect();
        Some(Slopes { response, by_delay, by_others })
    }
}

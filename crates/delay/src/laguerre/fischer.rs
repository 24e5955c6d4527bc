//! The delay whose shifted input explains the output in the Laguerre domain.
//!
//! Equation: x(t) has the spectrum xₖ = Σ x(t)·lₖ(t). The sequences are l₀ = √(1 − a²)·z/(z − a), lₖ₊₁ = w·lₖ, w = (1 − az)/(z − a). A transfer function keeps
//! its order under z⁻¹ = (w + a)/(1 + aw). A sample of delay is the filter (w + a)/(1 + aw) along k. b/(1 + f₁z⁻¹ + f₂z⁻²) is a filter of two poles with the
//! zeros of (1 + aw)². The estimate is τ̂ = Ts·argmin over nk of V(nk), V = Σₖ (yₖ − ŷₖ)². ŷ is the best output-error model of that form on the spectrum of u(t
//! − nk).

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, long_enough, options};
use crate::method::{Condition, Information, Law, Method, ReferenceExperiment, Start, method_line};
use crate::posterior;
use deadtime_identify::{Initial, OutputError, Record, laguerre_spectra};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a stable plant of two poles in open loop that rests at the start; no missing samples. The noise is white; orthonormal sequences keep it white.
/// Steps and pulses suffice as inputs; no persistent excitation is needed.
/// Resolution and cost: one sample. O(N·order) for the spectra; for each delay a search over two poles on `order` values, independent of N.
/// Fails when: the input is faster than the sequences, which cover about the lowest order/N of the frequencies (a wide interval, or `flat`). Input motion after
/// the part of the record that they cover has the same result. A plant of higher order is early or late by one or two samples. Missing outputs give
/// `not_applicable`. Feedback biases the estimate.
/// Source: Fischer and Medvedev (1999), "L2 time delay estimation by means of Laguerre functions", Proc. ACC, 455-459, doi:10.1109/ACC.1999.782869, for the
/// spectrum of a delayed signal. For models in the Laguerre domain "Laguerre shift identification of a pressurized process" by the same authors (late 1990s).
/// Björklund (2003), LiU-TEK-LIC-2003:60, class 1c (`fischer`): good on steps and poor on random inputs. Neither paper was available, only later accounts of
/// them. The authors identify by a subspace method; the model here is that of `oestruc`. The pole makes the given number of sequences fill 80 % of the longest
/// record; Björklund does not give his choice.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, Fischer, Search};
/// use deadtime_signal::time::SampleTime;
/// let u: Vec<f64> = (0..400).map(|t| if (50..200).contains(&t) { 1.0 } else { 0.0 }).collect();
/// let mut y = vec![0.0; 400];
/// for t in 5..400 {
///     y[t] = 0.8 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Fischer::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fischer {
    /// Laguerre sequences; default 60: fewer blur the edges of steps, more mainly cost time.
    pub order: usize,
}

impl Default for Fischer {
    fn default() -> Self {
        Self { order: 60 }
    }
}

const NAME: &str = "fischer";

/// Fewer sequences leave the model too few data.
const LEAST: usize = 10;

/// The share of a record that the sequences fill. Sequences must decay within the record, because later samples are unknown.
const FILLED: f64 = 0.8;

/// Poles of the model, as in `oestruc`.
const POLES: usize = 2;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    reference: ReferenceExperiment::Steps,
    information: Information::Poles(POLES),
    withstands: &[Condition::Dynamics],
    needs: "open loop, a stable plant of low order that rests at the start, steps or other slow input",
    blind_to: "fractions of a sample; input faster than its sequences; feedback",
    exempt: &[(Law::Exact, "the sequences see only the slow part of a rich input")],
    ..method_line!(
        "fischer",
        "best output-error model over all delays in the Laguerre domain: for steps",
        Fischer,
        Laguerre
    )
};

impl PairMethod for Fischer {
    fn check(&self) -> Result<(), DelayError> {
        options(NAME, [("order", self.order as f64, self.order >= LEAST, "10 or more")])
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let (max_delay, got) = (pair.max_delay, pair.experiment.longest());
        let remedy = LengthRemedy::WindowOr("set a smaller order");
        long_enough(NAME, max_delay + 2 * self.order, got, remedy)?;
        pair.complete("output samples are missing, and sums over all of them are needed")?;
        pair.visible()?;
        let mut spectra = self.spectra(pair.records, got);
        let orders = OutputError { nb: 1, nf: POLES, initial: Initial::Zero };
        let mut losses = Vec::with_capacity(max_delay + 1);
        let mut residuals: Vec<f64> = Vec::new();
        let mut smallest = f64::INFINITY;
        for _ in 0..=max_delay {
            let fit = orders.scan(&spectra.records, 0).pop().flatten();
            losses.push(fit.as_ref().map_or(f64::NAN, |f| f.loss));
            if let Some(fit) = fit.filter(|f| f.loss < smallest) {
                smallest = fit.loss;
                residuals = orders.residuals(&spectra.records, 0, &fit.f).unwrap_or_default();
            }
            spectra.delay();
        }
        let power = deadtime_identify::power(&spectra.records);
        let exact = smallest <= posterior::ROUNDING * power;
        let independent =
            if exact { residuals.len() as f64 } else { posterior::effective_samples(&residuals) };
        let Some(posterior) = posterior::posterior(&losses, power, independent) else {
            let note = "the input is zero wherever the sequences could see it";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        let delays = max_delay + 1;
        if posterior.set > delays / 2 {
            let note = format!("{} of {delays} delays fit equally well", posterior.set);
            return Err(NoDelay::new(Outcome::Flat, note));
        }
        let (raw, [from, to]) = (posterior.best as f64, posterior.ends);
        Ok(pair.counted(raw, posterior.std, [from - 0.5, to + 0.5]))
    }
}

/// The spectra of the records, and the pole of their sequences.
struct LaguerreSpectra {
    records: Vec<Record<'static>>,
    pole: f64,
}

impl LaguerreSpectra {
    /// The input one sample later: (w + a)/(1 + aw).
    fn delay(&mut self) {
        for record in &mut self.records {
            record.u = along(&record.u, [self.pole, 1.0], self.pole).into();
        }
    }
}

impl Fischer {
    /// The spectra in sequences that fill the longest record, of `longest` samples.
    fn spectra(&self, records: &[Record], longest: usize) -> LaguerreSpectra {
        // Each sequence delays the next by (1 + a)/(1 − a) samples.
        let each = (FILLED * longest as f64 / self.order as f64).max(1.0);
        let pole = (each - 1.0) / (each + 1.0);
        let spectrum = |r: &Record| {
            let order = self.order.min((FILLED * r.len() as f64 / each) as usize);
            let [u, y] = laguerre_spectra([&r.u, &r.y], pole, order);
            // The zeros of the model, (1 + aw)².
            Record::new(along(&along(&u, [1.0, pole], 0.0), [1.0, pole], 0.0), y)
        };
        LaguerreSpectra { records: records.iter().map(spectrum).collect(), pole }
    }
}

/// (b₀ + b₁w)/(1 + f·w) along a spectrum.
fn along(x: &[f64], b: [f64; 2], f: f64) -> Vec<f64> {
    let (mut before, mut last) = (0.0, 0.0);
    x.iter()
        .map(|&x| {
            last = b[0] * x + b[1] * before - f * last;
            before = x;
            last
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_is_a_filter_along_the_spectrum() {
        let u: Vec<f64> = (0..2000)
            .map(|t| if (40..160).contains(&t) { 1.0 + 0.01 * t as f64 } else { 0.0 })
            .collect();
        let later: Vec<f64> = (0..2000).map(|t| if t < 7 { 0.0 } else { u[t - 7] }).collect();
        let [mut spectrum, expected] = laguerre_spectra([&u, &later], 0.8, 80);
        for _ in 0..7 {
            spectrum = along(&spectrum, [0.8, 1.0], 0.8);
        }
        for (s, e) in spectrum.iter().zip(&expected) {
            assert!((s - e).abs() < 1e-9 * expected[0].abs().max(1.0), "{s} {e}");
        }
    }
}

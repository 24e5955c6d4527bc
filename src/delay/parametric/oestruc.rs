//! The delay whose output-error model simulates best.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, y(t) = B(q)/F(q) u(t − nk) + e(t).

use crate::delay::method::WHOLE;
use crate::delay::{
    Class, Condition, DelayError, DelayEstimate, DelayEstimator, Experiment, Information, Method, Outcome, PairEstimate, Scope, Search,
    Start, Suits, every_pair, posterior,
};
use crate::identify::{Initial, OutputError, Record};
use crate::registry::entry;

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a stable plant in open loop, noise that is not correlated with the input, a record that starts at rest (or `initial: estimated`).
/// Resolution and cost: one sample; some hundred filter passes over the record per delay.
/// Fails when: the plant is unstable (the predictor is kept stable, so the best one ends at the edge of stability: `not_converged`), the input is an impulse and
/// the start is estimated (many delays fit exactly: `flat`), or under feedback (biased).
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.4 (nb 1, nf 2, no prewhitening: the best of his comparison); MATLAB `oe`.
///
/// # Example
/// ```
/// use deadtime::delay::{DelayEstimator, Experiment, Oestruc, Search};
/// use deadtime::signal::{Excitation, excitation::Rbs};
/// use deadtime::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(300, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 300];
/// for t in 5..300 {
///     y[t] = 0.8 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, u, y);
/// let answer = Oestruc::default().estimate(&experiment, &Search::default())?;
/// assert!((answer[0].estimate.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Oestruc {
    /// Numerator coefficients; default 1: more make the delay ambiguous (Björklund, p. 104).
    pub nb: usize,
    /// Poles; default 2.
    pub nf: usize,
    /// The start of a record; default at rest.
    pub initial: Initial,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the loss says nothing new.
    pub max_samples: usize,
}

impl Default for Oestruc {
    fn default() -> Self {
        Self { nb: 1, nf: 2, initial: Initial::Zero, max_samples: 100_000 }
    }
}

const NAME: &str = "oestruc";

/// Its line in the list of methods.
pub(in crate::delay) const METHOD: Method = Method {
    entry: entry!(
        "oestruc",
        "best output-error model B/F over all delays (nb 1, nf 2): the most accurate on open-loop data",
        Oestruc,
        dyn DelayEstimator
    ),
    class: Class::Parametric,
    scope: Scope::Pair,
    start: Start::Rest,
    suits: Suits::Plant,
    information: Information::Poles(2),
    tolerance: WHOLE,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics, Condition::MissingOutputs],
    needs: "open loop, a stable plant of low order that rests at the start",
    blind_to: "fractions of a sample; what an unstable plant or feedback does",
    exempt: &[],
};

impl DelayEstimator for Oestruc {
    fn estimate(&self, experiment: &Experiment, search: &Search) -> Result<Vec<PairEstimate>, DelayError> {
        use crate::identify::MAX_OE_ORDER;
        #[allow(clippy::cast_precision_loss)]
        for (option, value, ok, allowed) in [
            ("nb", self.nb, self.nb >= 1, "1 or more"),
            ("nf", self.nf, self.nf <= MAX_OE_ORDER, "at most 16"),
            ("max_samples", self.max_samples, self.max_samples >= 1, "1 or more"),
        ] {
            if !ok {
                return Err(DelayError::Option { method: NAME, option, value: value as f64, allowed });
            }
        }
        every_pair(experiment, search, |records, max_delay, bias| self.pair(records, max_delay, bias, experiment))
    }
}

impl Oestruc {
    fn pair(&self, records: &[Record], max_delay: usize, bias: usize, experiment: &Experiment) -> Result<DelayEstimate, DelayError> {
        let parameters = self.nb + self.nf;
        let needed = max_delay + self.nb + 3 * parameters;
        let got = experiment.longest();
        if got < needed {
            return Err(DelayError::TooShort { method: NAME, needed, got, remedy: "search a shorter --max-delay" });
        }
        let shortened = got > self.max_samples;
        let cut: Vec<Record>;
        let records = if shortened {
            cut = records.iter().map(|r| head(r, self.max_samples)).collect();
            &cut
        } else {
            records
        };
        let orders = OutputError { nb: self.nb, nf: self.nf, initial: self.initial };
        let fits = orders.scan(records, max_delay);
        let losses: Vec<f64> = fits.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect();
        let power = crate::identify::power(records);
        let smallest = losses.iter().copied().filter(|v| v.is_finite()).min_by(f64::total_cmp);
        let Some(at) = smallest.and_then(|v| losses.iter().position(|&l| l == v)) else {
            return Ok(DelayEstimate::without(Outcome::NotRichEnough, "the input is zero wherever a model could use it"));
        };
        let residuals = fits[at].as_ref().and_then(|fit| orders.residuals(records, at, &fit.f)).unwrap_or_default();
        // Residuals of rounding size are correlated as rounding happens to be, which says nothing of how much the data know.
        #[allow(clippy::cast_precision_loss)]
        let exact = losses[at] <= posterior::ROUNDING * power;
        let independent = if exact { residuals.len() as f64 } else { posterior::effective_samples(&residuals) };
        let Some(posterior) = posterior::posterior(&losses, power, independent) else {
            return Ok(DelayEstimate::without(Outcome::Singular, "no delay has a finite loss: the numbers overflow; scale the channels"));
        };
        let best = posterior.best;
        let delays = max_delay + 1;
        let measured =
            records.iter().flat_map(|r| (0..r.len()).map(|t| if r.present.as_ref().is_none_or(|p| p[t]) { r.y[t] } else { 0.0 }));
        let model: Vec<f64> = measured.zip(&residuals).map(|(y, e)| y - e).collect();
        let counting = if exact { independent } else { posterior::samples_under(&model, &residuals) };
        let gain = counting * (power / losses[best].max(f64::MIN_POSITIVE)).ln();
        let free = parameters + if self.initial == Initial::Estimated { self.nf } else { 0 };
        // A pole pair may settle on any of N/2 frequencies, where the delay is but a phase: these are tries too.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let tried = delays + if self.nf >= 2 { (counting / 2.0) as usize } else { 0 };
        if gain < posterior::visible_gain(free, tried) {
            let note = format!("no model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input");
            return Ok(DelayEstimate::without(Outcome::NotVisible, note));
        }
        // An output-error model that fits exactly does so for one delay only; several mean that the data do not tell them apart.
        if posterior.set > delays / 2 || posterior.ties > 1 {
            let same = posterior.set.max(posterior.ties);
            return Ok(DelayEstimate::without(Outcome::Flat, format!("{same} of {delays} delays fit equally well")));
        }
        if let Some(fit) = fits[best].as_ref().filter(|f| !f.stopped.converged()) {
            let note = format!(
                "the optimiser stopped without a minimum ({:?}) at nk = {best}, poles at |z| up to {:.4}: an unstable or integrating plant, or feedback",
                fit.stopped,
                crate::identify::largest_pole(&fit.f)
            );
            return Ok(DelayEstimate::without(Outcome::NotConverged, note));
        }
        #[allow(clippy::cast_precision_loss)]
        let raw = best as f64;
        let note = shortened.then(|| format!("used the first {} of {got} samples", self.max_samples));
        let [from, to] = posterior.ends;
        let estimate = DelayEstimate::counted(
            raw,
            posterior.std,
            posterior::first_coefficient(from, to, bias),
            best == max_delay,
            bias,
            experiment.sample_time,
        );
        Ok(estimate.noting(note))
    }
}

fn head(record: &Record, samples: usize) -> Record {
    let n = record.len().min(samples);
    Record { u: record.u[..n].to_vec(), y: record.y[..n].to_vec(), present: record.present.as_ref().map(|p| p[..n].to_vec()) }
}

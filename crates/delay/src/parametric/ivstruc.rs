//! The delay whose model by refined instrumental variables leaves the smallest innovations.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ(D v)²/N, v = y − B(q)/F(q) u(t − nk), D an autoregression that whitens v; F and B solve
//! Σ ζ(y_f − φᵀθ) = 0 with φ = (−y_f(t − 1) …, u_f(t − nk) …), ζ the same of the simulated output, all filtered by D/F.

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search, one_pair};
use crate::experiment::Experiment;
use crate::method::WHOLE;
use crate::method::{
    Basis, Class, Condition, Information, Law, Method, ReferenceExperiment, Scope, Start,
};
use crate::posterior;
use deadtime_identify::{MAX_OE_ORDER, Record, RefinedIv};
use deadtime_signal::registry::entry;
use deadtime_signal::stop::Stop;

/// Inputs: u, y on one even grid, without missing samples. Output: seconds, positive = y lags u.
///
/// Assumes: a stable plant in open loop that rests at the start; noise of any colour that an autoregression describes and that the input does not know of.
/// Resolution and cost: one sample; some ten rounds of ten filter passes per delay.
/// Fails when: noise and input are correlated, as under feedback (biased: the simulated output is then no instrument); the plant is unstable (its mirrored poles
/// do not settle: `not_converged`); B/F has too few coefficients for a fast input.
/// MATLAB's `ivstruc` solves once per delay with fixed instruments, a high-order ARX model's simulation, and compares simulation errors; they are not minimised by
/// that solution, and coloured noise makes them poor evidence. Here each delay has its own refined solution, and errors are whitened before they are compared.
/// Source: Young (2011), "Recursive Estimation and Time-Series Analysis", 2nd ed., chapter 7, doi:10.1007/978-3-642-21981-8; Ljung (1999), "System
/// Identification", 2nd ed., section 7.6; MATLAB `ivstruc`. They leave open what to do with a round that is unstable (mirrored here) or does not settle (the round
/// with the smallest loss here), and how to choose the noise's order.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, Ivstruc, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(300, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 300];
/// for t in 5..300 {
///     y[t] = 0.8 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Ivstruc::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ivstruc {
    /// Numerator coefficients; default 1, as for `oestruc`.
    pub nb: usize,
    /// Poles of the plant; default 2, as for `oestruc`.
    pub nf: usize,
    /// Poles of the noise; default 4, which also whitens what two poles of the plant leave.
    pub noise: usize,
    /// Longest part of a record that is used, samples; default 20 000: every round filters every signal anew.
    pub max_samples: usize,
}

impl Default for Ivstruc {
    fn default() -> Self {
        Self { nb: 1, nf: 2, noise: 4, max_samples: 20_000 }
    }
}

const NAME: &str = "ivstruc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "ivstruc",
        "best model B/F by refined instrumental variables over all delays (nb 1, nf 2, noise AR 4): open loop, coloured noise",
        Ivstruc,
        dyn DelayEstimator
    ),
    class: Class::Parametric,
    scope: Scope::Pair,
    start: Start::Rest,
    reference: ReferenceExperiment::Plant,
    information: Information::Poles(2),
    basis: Basis::Own,
    tolerance: WHOLE,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics],
    needs: "open loop, a stable plant of low order that rests at the start, no missing sample",
    blind_to: "fractions of a sample; what an unstable plant or feedback does",
    exempt: &[(
        Law::Exact,
        "rounds need not settle where two poles and one coefficient are too few and no noise hides it: not_converged, seldom",
    )],
};

impl DelayEstimator for Ivstruc {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        for (option, value, ok, allowed) in [
            ("nb", self.nb, (1..=MAX_OE_ORDER).contains(&self.nb), "from 1 to 16"),
            ("nf", self.nf, self.nf <= MAX_OE_ORDER, "at most 16"),
            ("noise", self.noise, self.noise <= 100, "at most 100"),
            ("max_samples", self.max_samples, self.max_samples >= 1, "1 or more"),
        ] {
            if !ok {
                return Err(DelayError::Option {
                    method: NAME,
                    option,
                    value: value as f64,
                    allowed,
                });
            }
        }
        one_pair(experiment, search, |records, max_delay, bias| {
            self.pair(records, max_delay, bias, experiment, &search.stop)
        })
    }
}

impl Ivstruc {
    fn pair(
        &self,
        records: &[Record],
        max_delay: usize,
        bias: usize,
        experiment: &Experiment,
        stop: &Stop,
    ) -> Result<DelayEstimate, DelayError> {
        let parameters = self.nb + self.nf;
        let needed = max_delay + self.nb + 3 * (parameters + self.noise);
        let got = experiment.longest();
        if got.min(self.max_samples) < needed {
            return Err(DelayError::TooShort {
                method: NAME,
                needed,
                got: got.min(self.max_samples),
                remedy: crate::error::LengthRemedy::Window,
            });
        }
        if records.iter().any(|r| r.present.as_ref().is_some_and(|p| p.contains(&false))) {
            return Ok(DelayEstimate::without(
                Outcome::NotApplicable,
                "missing output samples: the instruments' filters need every one",
            ));
        }
        let cut = super::misfit::heads(records, self.max_samples);
        let records = cut.as_deref().unwrap_or(records);
        let orders = RefinedIv { nb: self.nb, nf: self.nf, noise: self.noise };
        let fits = orders.scan_until(records, max_delay, stop);
        let losses: Vec<f64> =
            fits.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect();
        let power = deadtime_identify::power(records);
        let rows = records.iter().map(|r| r.len().saturating_sub(self.noise)).sum::<usize>() as f64;
        let (Some(posterior), Some(without)) =
            (posterior::posterior(&losses, power, rows), orders.loss_without_input(records))
        else {
            return Ok(DelayEstimate::without(
                Outcome::Singular,
                "no delay has a finite loss: the numbers overflow; scale the channels",
            ));
        };
        let best = posterior.best;
        let delays = max_delay + 1;
        let gain = rows * (without / losses[best].max(f64::MIN_POSITIVE)).ln();
        // A pole pair may settle on any of N/2 frequencies, where the delay is but a phase: these are tries too.
        let tried = delays + if self.nf >= 2 { (rows / 2.0) as usize } else { 0 };
        if gain < posterior::visible_gain(parameters, tried) {
            let note = format!(
                "past outputs alone predict as well (gain {gain:.1}): the output does not visibly follow the input"
            );
            return Ok(DelayEstimate::without(Outcome::NotVisible, note));
        }
        // A noise model of few poles takes what is slow or comes in jumps for a response: the ARX model's many must see the input too.
        let exact = losses[best] <= posterior::ROUNDING * power;
        if let Some(note) = (!exact).then(|| posterior::unseen(records, max_delay)).flatten() {
            return Ok(DelayEstimate::without(Outcome::NotVisible, note));
        }
        // Its noise model takes over what no delay of the window explains, and then hardly a loss differs: half of the delays is enough to be called flat.
        if posterior.set > delays / 2 || posterior.ties > 1 {
            let same = posterior.set.max(posterior.ties);
            return Ok(DelayEstimate::without(
                Outcome::Flat,
                format!("{same} of {delays} delays fit equally well"),
            ));
        }
        // A loss that is zero but for rounding changes with rounding from round to round.
        if let Some(fit) = fits[best].as_ref().filter(|f| !f.converged && !exact) {
            let note = format!(
                "the rounds did not settle at nk = {best}, poles at |z| up to {:.4}: an unstable plant, feedback, or too small a model",
                deadtime_identify::largest_pole(&fit.f)
            );
            return Ok(DelayEstimate::without(Outcome::NotConverged, note));
        }
        let raw = best as f64;
        let note =
            cut.is_some().then(|| format!("used the first {} of {got} samples", self.max_samples));
        let [from, to] = posterior.ends;
        let estimate = DelayEstimate::counted(
            raw,
            posterior.std,
            posterior::first_coefficient(from, to, bias),
            best == max_delay,
            bias,
            experiment.sample_time(),
        );
        Ok(estimate.noting(note))
    }
}

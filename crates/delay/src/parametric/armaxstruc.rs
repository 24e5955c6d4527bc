//! The delay whose ARMAX model predicts best.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, A(q) y(t) = B(q) u(t − nk) + C(q) e(t), C with its roots inside the unit circle and A with its own
//! anywhere: y is predicted one step ahead, never simulated. Leading coefficients of B that the data do not ask for are taken off the answer as in `arxstruc`.

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search, one_pair};
use crate::experiment::Experiment;
use crate::method::WHOLE;
use crate::method::{
    Basis, Class, Condition, Information, Method, ReferenceExperiment, Scope, Start,
};
use crate::posterior;
use deadtime_identify::{Armax, ArmaxFit, MAX_OE_ORDER, Record};
use deadtime_signal::registry::entry;
use deadtime_signal::stop::Stop;

/// Inputs: u, y on one even grid; under feedback u must be what the plant received, not the reference. Output: seconds, positive = y lags u.
///
/// Assumes: a linear plant and noise that an ARMA process of these orders describes; nothing of the stability of the plant, of the loop around it, or of the start.
/// Resolution and cost: one sample; some ten filter passes per delay that is not hopeless beside a long ARX model's.
/// Fails when: the orders are too low for plant and noise together (white noise on the output of a plant of n poles needs na = nc = n; noise with poles of its own
/// needs as many more in na and nb): the residuals are then coloured or follow past inputs, and the note says so. When the only excitation is the loop's own noise
/// and the controller is so simple that another plant explains the data as well: many delays fit (`flat`, or a wide interval). When the first coefficient of B is
/// small against the noise, the delay is found late. Delays below the bias are not searched: the plant cannot have them, but a controller that answers within the
/// sample makes u(t) tell y(t) all but exactly; with a bias of 0 such a loop has no answer.
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2, 7.2, 13.4 (closed loop) and 16.5-16.6 (residual tests); Forssell and Ljung (1999),
/// "Closed-loop identification revisited", Automatica 35, 1215-1241, doi:10.1016/S0005-1098(99)00022-9; Ljung and Box (1978), doi:10.1093/biomet/65.2.297.
/// The sources fit one delay; scanning it, the posterior over it and the numerators weighed by evidence are those of `oestruc` and `arxstruc`. How many poles to
/// give the noise they leave to the user.
///
/// # Example
/// ```
/// use deadtime_delay::{Armaxstruc, DelayEstimator, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let dither = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let (mut u, mut y) = (vec![0.0; 400], vec![0.0; 400]);
/// for t in 0..400 {
///     if t >= 3 {
///         y[t] = 1.05 * y[t - 1] + 0.2 * u[t - 3]; // unstable; two samples of delay and one of the hold
///     }
///     u[t] = dither[t] - 0.6 * y[t]; // held by feedback
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Armaxstruc::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.2).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Armaxstruc {
    /// Past outputs; default 3: two poles of the plant and one of the noise.
    pub na: usize,
    /// Most input coefficients; default 3, for the same reason.
    pub nb: usize,
    /// Past errors; default 2: white noise on the output of a plant of two poles.
    pub nc: usize,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the loss says nothing new.
    pub max_samples: usize,
}

impl Default for Armaxstruc {
    fn default() -> Self {
        Self { na: 3, nb: 3, nc: 2, max_samples: 100_000 }
    }
}

const NAME: &str = "armaxstruc";

/// From this radius on a root of C stands at the edge of what predicts: the loss falls towards it, and that edge is the minimum.
const CIRCLE: f64 = 0.9999;

fn on_circle(fit: &ArmaxFit) -> bool {
    deadtime_identify::largest_pole(&fit.c) >= CIRCLE
}

/// What a search that stopped early may have left to gain, of N·ln V, before its delay is not believed: a factor e of probability.
const WORTH: f64 = 2.0;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "armaxstruc",
        "best ARMAX predictor over all delays (3, 3, 2): unstable plants, feedback and coloured noise",
        Armaxstruc,
        dyn DelayEstimator
    ),
    class: Class::Parametric,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Plant,
    information: Information::Poles(2),
    basis: Basis::Own,
    tolerance: WHOLE,
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
        Condition::MissingOutputs,
    ],
    needs: "the input that the plant received; plant and noise of low order",
    blind_to: "fractions of a sample; a first coefficient that is small against the noise",
    exempt: &[],
};

impl DelayEstimator for Armaxstruc {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        for (option, value, ok, allowed) in [
            ("na", self.na, self.na <= MAX_OE_ORDER, "at most 16"),
            ("nb", self.nb, (1..=MAX_OE_ORDER).contains(&self.nb), "from 1 to 16"),
            ("nc", self.nc, self.nc <= MAX_OE_ORDER, "at most 16"),
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

impl Armaxstruc {
    fn pair(
        &self,
        records: &[Record],
        max_delay: usize,
        bias: usize,
        experiment: &Experiment,
        stop: &Stop,
    ) -> Result<DelayEstimate, DelayError> {
        let cut = super::misfit::heads(records, self.max_samples);
        let records = cut.as_deref().unwrap_or(records);
        let orders = Armax { na: self.na, nb: self.nb, nc: self.nc };
        let scan = orders.scan_until(records, 0, max_delay, stop);
        if scan.rows < orders.rows_needed() {
            return Err(DelayError::TooShort {
                method: NAME,
                needed: self.na.max(max_delay + self.nb - 1) + orders.rows_needed(),
                got: experiment.longest().min(self.max_samples),
                remedy: crate::error::LengthRemedy::WindowOr("set smaller na, nb and nc"),
            });
        }
        let losses: Vec<Vec<f64>> = scan
            .fits
            .iter()
            .map(|counts| counts.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect())
            .collect();
        let full: Vec<f64> =
            losses.iter().map(|counts| counts.last().copied().unwrap_or(f64::NAN)).collect();
        let rows = scan.rows as f64;
        let minimum = (0..full.len())
            .filter(|&nk| full[nk].is_finite())
            .min_by(|&a, &b| full[a].total_cmp(&full[b]));
        let (Some(minimum), Some(posterior), Some(without)) = (
            minimum,
            posterior::posterior_of_start(&losses, scan.power, rows),
            &scan.without_input,
        ) else {
            return Ok(DelayEstimate::without(
                Outcome::Singular,
                "no delay has a finite loss: the numbers overflow; scale the channels",
            ));
        };
        let best = posterior.best;
        let delays = max_delay + 1;
        let gain = rows * (without.loss / full[minimum].max(f64::MIN_POSITIVE)).ln();
        // A pair of roots of A and C may settle on any of N/2 frequencies: these are tries too.
        let tried = delays + if self.na.min(self.nc) >= 2 { scan.rows / 2 } else { 0 };
        if gain < posterior::visible_gain(self.nb, tried) {
            let note = format!(
                "past outputs alone predict as well (gain {gain:.1}): the output does not visibly follow the input"
            );
            return Ok(DelayEstimate::without(Outcome::NotVisible, note));
        }
        if posterior.is_flat() {
            return Ok(DelayEstimate::without(
                Outcome::Flat,
                format!("{} of {delays} delays fit equally well", posterior.set),
            ));
        }
        // The most probable number of coefficients at the most probable delay.
        let evidence = |m: usize| {
            -rows * losses[best][m].max(posterior::ROUNDING * scan.power).ln()
                - (m as f64) * rows.ln()
        };
        let count = (0..self.nb)
            .filter(|&m| losses[best][m].is_finite())
            .max_by(|&a, &b| evidence(a).total_cmp(&evidence(b)));
        let fit = count.and_then(|m| scan.fits[best][m].as_ref());
        if let Some(fit) =
            fit.filter(|f| !f.stopped.converged() && f.to_gain > WORTH && !on_circle(f))
        {
            let note = format!(
                "the optimiser stopped without a minimum ({:?}) at nk = {best}, with {:.1} to gain and roots of C at |z| up to {:.4}",
                fit.stopped,
                fit.to_gain,
                deadtime_identify::largest_pole(&fit.c)
            );
            return Ok(DelayEstimate::without(Outcome::NotConverged, note));
        }
        let misfit = fit.filter(|f| f.loss > posterior::ROUNDING * scan.power).and_then(|f| {
            let residuals = orders.residuals(records, max_delay, best, f);
            super::misfit::misfit(&residuals, self.na + self.nc, best + f.b.len())
        });
        let (start, raw) = (best as f64, minimum as f64);
        let estimate = DelayEstimate::counted(
            start,
            posterior.std,
            posterior::first_coefficient(posterior.ends[0], posterior.ends[1], bias),
            best == max_delay,
            bias,
            experiment.sample_time(),
        );
        let used = cut.is_some().then(|| {
            format!("used the first {} of {} samples", self.max_samples, experiment.longest())
        });
        Ok(DelayEstimate {
            raw_delay_s: Some(experiment.sample_time().to_seconds(raw)),
            ..estimate
        }
        .noting(leading_zeros(best, minimum))
        .noting(fit.and_then(unstable))
        .noting(fit.and_then(edge))
        .noting(misfit)
        .noting(used))
    }
}

fn leading_zeros(best: usize, minimum: usize) -> Option<String> {
    let leading = best.checked_sub(minimum).filter(|&n| n > 0)?;
    Some(format!(
        "the smallest loss is at nk = {minimum}, but its first {leading} input coefficients are zero within the noise"
    ))
}

fn unstable(fit: &ArmaxFit) -> Option<String> {
    let pole = deadtime_identify::largest_pole(&fit.a);
    (pole > 1.0).then(|| format!("the plant's model is unstable (|z| = {pole:.3})"))
}

fn edge(fit: &ArmaxFit) -> Option<String> {
    on_circle(fit).then(|| {
        "the noise model has a root on the unit circle: too many orders, or a drift taken off"
            .to_owned()
    })
}

//! The delay of the ARMAX model with the best prediction.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, A(q) y(t) = B(q) u(t − nk) + C(q) e(t). The roots of C lie inside the unit circle, those of A
//! anywhere: y is predicted one step ahead, never simulated. The estimate leaves out leading coefficients of B that the data do not support, as in `arxstruc`.

use super::arxstruc::leading_zeros;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, options, seen};
use crate::method::{Condition, Information, Method, method_line};
use crate::posterior;
use deadtime_identify::{Armax, ArmaxFit, MAX_OE_ORDER};

/// Inputs: u, y on one even grid; under feedback u must be what the plant received, not the reference. Output: seconds, positive = y lags u.
///
/// Assumes: a linear plant and noise that an ARMA process of these orders describes. The plant may be unstable, in a loop, and in motion at the start.
/// Resolution and cost: one sample; about ten filter passes for each delay whose long ARX model is not far worse than the best.
/// Fails when: the orders are too low for plant and noise together: the residuals are then coloured or follow past inputs (reported in a note). White noise on
/// the output of a plant of n poles needs na = nc = n. Noise with poles of its own needs as many more in na and nb. With the loop's own noise as the only
/// excitation, and a simple controller, another plant explains the data equally well. Many delays then fit (`flat`, or a wide interval). A first coefficient of
/// B that is small compared with the noise biases the delay late. Delays below the bias are not searched, because the plant cannot have them. A controller
/// within the sample would make u(t) predict y(t) almost exactly; with a bias of 0 such a loop has no result.
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2, 7.2, 13.4 (closed loop) and 16.5-16.6 (residual tests). Forssell and Ljung (1999),
/// "Closed-loop identification revisited", Automatica 35, 1215-1241, doi:10.1016/S0005-1098(99)00022-9. Ljung and Box (1978), doi:10.1093/biomet/65.2.297. The
/// sources fit one delay; the scan, its posterior and the evidence-weighted numerators are those of `oestruc` and `arxstruc`. The sources leave the number of
/// noise poles to the user.
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
    /// Largest number of input coefficients; default 3, for the same reason.
    pub nb: usize,
    /// Past errors; default 2: white noise on the output of a plant of two poles.
    pub nc: usize,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the loss changes little.
    pub max_samples: usize,
}

impl Default for Armaxstruc {
    fn default() -> Self {
        Self { na: 3, nb: 3, nc: 2, max_samples: 100_000 }
    }
}

const NAME: &str = "armaxstruc";

/// A root of C from this radius on is at the edge of valid predictors. The loss falls towards that edge, which is then the minimum.
const CIRCLE: f64 = 0.9999;

fn on_circle(fit: &ArmaxFit) -> bool {
    deadtime_identify::largest_pole(&fit.c) >= CIRCLE
}

/// Decrease of N·ln V that a search stopped early may have left before its delay is rejected: a factor e of probability.
const WORTH: f64 = 2.0;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Poles(2),
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
        Condition::MissingOutputs,
        Condition::InverseResponse,
    ],
    needs: "the input that the plant received; plant and noise of low order",
    blind_to: "fractions of a sample; a first coefficient that is small against the noise",
    ..method_line!(
        "armaxstruc",
        "best ARMAX predictor over all delays (3, 3, 2): unstable plants, feedback and coloured noise",
        Armaxstruc,
        Parametric
    )
};

impl PairMethod for Armaxstruc {
    fn check(&self) -> Result<(), DelayError> {
        let Self { na, nb, nc, max_samples } = *self;
        let rows = [
            ("na", na as f64, na <= MAX_OE_ORDER, "at most 16"),
            ("nb", nb as f64, (1..=MAX_OE_ORDER).contains(&nb), "from 1 to 16"),
            ("nc", nc as f64, nc <= MAX_OE_ORDER, "at most 16"),
            ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let max_delay = pair.max_delay;
        let (records, used) = pair.heads(self.max_samples);
        let orders = Armax { na: self.na, nb: self.nb, nc: self.nc };
        let scan = orders.scan_until(&records, 0, max_delay, pair.stop);
        if scan.rows < orders.rows_needed() {
            return Err(DelayError::TooShort {
                method: NAME,
                needed: self.na.max(max_delay + self.nb - 1) + orders.rows_needed(),
                got: pair.experiment.longest().min(self.max_samples),
                remedy: LengthRemedy::WindowOr("set smaller na, nb and nc"),
            }
            .into());
        }
        let of_count = |f: &Option<ArmaxFit>| f.as_ref().map_or(f64::NAN, |f| f.loss);
        let losses: Vec<Vec<f64>> =
            scan.fits.iter().map(|counts| counts.iter().map(of_count).collect()).collect();
        let full: Vec<f64> =
            losses.iter().map(|counts| counts.last().copied().unwrap_or(f64::NAN)).collect();
        let rows = scan.rows as f64;
        let (Some(minimum), Some(posterior), Some(without)) = (
            posterior::smallest(&full),
            posterior::posterior_of_start(&losses, scan.power, rows),
            &scan.without_input,
        ) else {
            return Err(NoDelay::overflow());
        };
        let gain = rows * (without.loss / full[minimum].max(f64::MIN_POSITIVE)).ln();
        // A pair of roots of A and C may converge to any of N/2 frequencies, which adds to the number of tests.
        let tried = max_delay + 1 + if self.na.min(self.nc) >= 2 { scan.rows / 2 } else { 0 };
        seen(posterior::unseen_at(gain, self.nb, tried))?;
        if posterior.is_flat() {
            return Err(NoDelay::flat(posterior.set, max_delay + 1));
        }
        let best = posterior.best;
        let fit =
            most_evident(&losses[best], rows, scan.power).and_then(|m| scan.fits[best][m].as_ref());
        fit.map_or(Ok(()), |f| settled(f, best))?;
        let misfit = fit.filter(|f| f.loss > posterior::ROUNDING * scan.power).and_then(|f| {
            let residuals = orders.residuals(&records, max_delay, best, f);
            super::misfit::misfit(&residuals, self.na + self.nc, best + f.b.len())
        });
        Ok(pair
            .most_probable(&posterior)
            .with_raw_s(pair.seconds(minimum as f64))
            .noting(leading_zeros(best, minimum))
            .noting(fit.and_then(unstable))
            .noting(fit.and_then(edge))
            .noting(misfit)
            .noting(used))
    }
}

/// The most probable number of coefficients minus one, from the losses of each.
fn most_evident(losses: &[f64], rows: f64, power: f64) -> Option<usize> {
    let evidence =
        |m: usize| -rows * losses[m].max(posterior::ROUNDING * power).ln() - (m as f64) * rows.ln();
    (0..losses.len())
        .filter(|&m| losses[m].is_finite())
        .max_by(|&a, &b| evidence(a).total_cmp(&evidence(b)))
}

/// The search for the model of delay `nk` ended at a minimum, or next to one.
fn settled(fit: &ArmaxFit, nk: usize) -> Result<(), NoDelay> {
    if fit.stopped.converged() || fit.to_gain <= WORTH || on_circle(fit) {
        return Ok(());
    }
    let note = format!(
        "the optimiser stopped without a minimum ({:?}) at nk = {nk}, with {:.1} to gain and roots of C at |z| up to {:.4}",
        fit.stopped,
        fit.to_gain,
        deadtime_identify::largest_pole(&fit.c)
    );
    Err(NoDelay::new(Outcome::NotConverged, note))
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

//! The delay whose ARMAX model predicts best.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, A(q) y(t) = B(q) u(t − nk) + C(q) e(t). The roots of C lie inside the unit circle, those of A anywhere: y is
//! predicted one step ahead, never simulated. The answer leaves out leading coefficients of B that the data do not support, as in `arxstruc`.

use super::arxstruc::leading_zeros;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, options, seen};
use crate::method::{Condition, Information, Method, method_line};
use crate::posterior;
use deadtime_identify::{Armax, ArmaxFit, MAX_OE_ORDER};

/// Inputs: u, y on one even grid; under feedback u must be what the plant received, not the reference. Output: seconds, positive = y lags u.
///
/// Assumes: a linear plant and noise that an ARMA process of these orders describes; nothing of the stability of the plant, of the loop around it, or of the start.
/// Resolution and cost: one sample; some ten filter passes for each delay whose long ARX model is not far worse than the best.
/// Fails when: the orders are too low for plant and noise together (white noise on the output of a plant of n poles needs na = nc = n; noise with poles of its own
/// needs as many more in na and nb): the residuals are then coloured or follow past inputs, and the note says so. When the only excitation is the loop's own noise
/// and the controller is so simple that another plant explains the data as well: many delays fit (`flat`, or a wide interval). When the first coefficient of B is
/// small against the noise, the delay is found late. Delays below the bias are not searched: the plant cannot have them, but a controller that answers within the
/// sample makes u(t) predict y(t) all but exactly; with a bias of 0 such a loop has no answer.
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

/// What a search that stopped early may have left to gain, of N·ln V, before its delay is rejected: a factor e of probability.
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
        // A pair of roots of A and C may settle on any of N/2 frequencies: these are tries too.
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

/// The most probable number of coefficients, less one, from the losses of each.
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

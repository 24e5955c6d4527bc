//! Evaluation of the losses of an output-error scan, for every method based on one.

use super::evidence::log_evidence;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::Outcome;
use crate::estimator::{NoDelay, PairRecords, long_enough, options};
use crate::posterior;
use crate::posterior::Posterior;
use deadtime_identify::{Initial, MAX_OE_ORDER, OeFit, OutputError, Record, largest_pole, power};
use deadtime_signal::fit::Stopped;

/// An output-error scan that passed all tests.
pub(super) struct Profile<'a> {
    /// The model of every delay.
    pub(super) fits: Vec<Option<OeFit>>,
    /// The posterior from their losses.
    pub(super) posterior: Posterior,
    /// Measured samples per independent residual of the best model.
    pub(super) per_independent: f64,
    /// The part of the records that was used.
    pub(super) records: Vec<Record<'a>>,
    /// A note for the reader.
    pub(super) note: Option<String>,
}

/// The evidence of a delay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Weighing {
    /// The loss of its best model.
    Best,
    /// The losses of all models, averaged over the prior of their poles; for orders without a prior the best one's.
    Average,
}

/// Refuses options out of their range.
pub(super) fn check(
    name: &'static str,
    orders: &OutputError,
    max_samples: usize,
) -> Result<(), DelayError> {
    let rows = [
        ("nb", orders.nb as f64, orders.nb >= 1, "1 or more"),
        ("nf", orders.nf as f64, orders.nf <= MAX_OE_ORDER, "at most 16"),
        ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
    ];
    options(name, rows)
}

/// The records shortened to `max_samples`, and the note that says so.
pub(super) fn shortened<'a>(
    records: &'a [Record<'_>],
    max_samples: usize,
) -> (Vec<Record<'a>>, Option<String>) {
    let got = records.iter().map(Record::len).max().unwrap_or(0);
    let note =
        (got > max_samples).then(|| format!("used the first {max_samples} of {got} samples"));
    (records.iter().map(|r| r.head(max_samples)).collect(), note)
}

/// The measured outputs less the residuals.
pub(super) fn model(records: &[Record], residuals: &[f64]) -> Vec<f64> {
    let measured = records.iter().flat_map(|r| {
        (0..r.len()).map(|t| if r.present.as_ref().is_none_or(|p| p[t]) { r.y[t] } else { 0.0 })
    });
    measured.zip(residuals).map(|(y, e)| y - e).collect()
}

/// Noise counts as slow from this many samples per independent one.
const SLOW: f64 = 4.0;

/// An output-error scan over all delays.
pub(super) struct OeScan {
    /// The calling method.
    pub(super) name: &'static str,
    /// Orders and initial state of the models.
    pub(super) orders: OutputError,
    /// Longest part of a record that is used, samples.
    pub(super) max_samples: usize,
}

/// The residual of the output under the model of the smallest loss.
struct Remainder {
    residuals: Vec<f64>,
    /// The residual is rounding.
    exact: bool,
    /// Independent samples among the residuals.
    independent: f64,
}

impl OeScan {
    /// The scan, or the outcome in its place: constant signals, no visible response, many equal delays, no minimum.
    pub(super) fn profile<'a>(
        &self,
        pair: &PairRecords<'a>,
        weighing: Weighing,
    ) -> Result<Profile<'a>, NoDelay> {
        let Self { name, orders, max_samples } = self;
        let needed = pair.max_delay + orders.nb + 3 * (orders.nb + orders.nf);
        let got = pair.records.iter().map(Record::len).max().unwrap_or(0);
        long_enough(name, needed, got, LengthRemedy::Window)?;
        let (records, note) = shortened(pair.records, *max_samples);
        let fits = pair.scans.fits(orders, &records, pair.max_delay, pair.stop);
        let losses: Vec<f64> =
            fits.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect();
        let power = power(&records);
        let floor = posterior::ROUNDING * power;
        let remainder = self.remainder(&records, &fits, &losses, floor)?;
        let (samples, independent) = (remainder.residuals.len() as f64, remainder.independent);
        let averaged = (weighing == Weighing::Average)
            .then(|| log_evidence(orders, &records, &fits, floor, samples, independent))
            .flatten();
        let exact = || losses.iter().filter(|&&v| v <= floor).count();
        let posterior = match averaged {
            Some(logs) => posterior::from_logs(&logs, exact()),
            None => posterior::posterior(&losses, power, independent),
        };
        let posterior = posterior.ok_or_else(NoDelay::overflow)?;
        let gain = (power / losses[posterior.best].max(f64::MIN_POSITIVE)).ln();
        self.seen(&pair.with(&records), &remainder, gain)?;
        // An exactly fitting output-error model does so for as many delays as it has numerator coefficients. More such delays mean that the data do not
        // distinguish them.
        if posterior.is_flat() || posterior.ties > orders.nb {
            return Err(NoDelay::flat(posterior.set.max(posterior.ties), pair.max_delay + 1));
        }
        let best = settled(&fits, &posterior, floor)?;
        let posterior = Posterior { best, ..posterior };
        Ok(Profile { fits, posterior, per_independent: samples / independent, records, note })
    }

    /// The residual of the model with the smallest loss.
    fn remainder(
        &self,
        records: &[Record],
        fits: &[Option<OeFit>],
        losses: &[f64],
        floor: f64,
    ) -> Result<Remainder, NoDelay> {
        let smallest = losses.iter().copied().filter(|v| v.is_finite()).min_by(f64::total_cmp);
        let Some(at) = smallest.and_then(|v| losses.iter().position(|&l| l == v)) else {
            let note = "the input is zero wherever a model could use it";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        let residuals = fits[at]
            .as_ref()
            .and_then(|fit| self.orders.residuals(records, at, &fit.f))
            .unwrap_or_default();
        // Residuals of rounding size have arbitrary correlations, without information on the delay.
        let exact = losses[at] <= floor;
        let independent =
            if exact { residuals.len() as f64 } else { posterior::effective_samples(&residuals) };
        Ok(Remainder { residuals, exact, independent })
    }

    /// Tests that the output visibly follows the input: the best model lowers the logarithm of its power by `gain`.
    fn seen(&self, pair: &PairRecords, remainder: &Remainder, gain: f64) -> Result<(), NoDelay> {
        let Remainder { residuals, exact, independent } = remainder;
        let orders = &self.orders;
        let counting = if *exact {
            *independent
        } else {
            posterior::samples_under(&model(pair.records, residuals), residuals)
        };
        let gain = counting * gain;
        let start = if orders.initial == Initial::Estimated { orders.nf } else { 0 };
        // A pole pair may converge to any band: N/2 narrow ones, half as many of twice the width, and so on, N in all. The bands add to the number of tests.
        let tried = pair.max_delay + 1 + if orders.nf >= 2 { counting as usize } else { 0 };
        if gain < posterior::visible_gain(orders.nb + orders.nf + start, tried) {
            let note = format!(
                "no model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input"
            );
            return Err(NoDelay::new(Outcome::NotVisible, note));
        }
        // Under such slow noise two unrelated signals drift together. The whitened test of an ARX model must detect the input, too.
        let complete = pair.records.iter().all(|r| r.present.is_none());
        if complete && !exact && SLOW * independent < residuals.len() as f64 {
            pair.visible()?;
        }
        Ok(())
    }
}

/// The most probable delay of the set whose model is at a minimum; a search that ends at the edge of stability gives no model.
fn settled(fits: &[Option<OeFit>], posterior: &Posterior, floor: f64) -> Result<usize, NoDelay> {
    // A residual of rounding size counts as converged.
    let converged = |nk: &usize| {
        fits[*nk].as_ref().is_some_and(|fit| fit.stopped.converged() || fit.loss <= floor)
    };
    let best = posterior.best;
    posterior.order[..posterior.set].iter().copied().find(converged).ok_or_else(|| {
        let (stopped, pole) = fits[best]
            .as_ref()
            .map_or((Stopped::Undefined, f64::NAN), |fit| (fit.stopped, largest_pole(&fit.f)));
        let note = format!(
            "the optimiser stopped without a minimum ({stopped:?}) at nk = {best}, poles at |z| up to {pole:.4}: an unstable or integrating plant, or feedback"
        );
        NoDelay::new(Outcome::NotConverged, note)
    })
}
